from hypothesis import given
from hypothesis import strategies as st
from tensorboard.compat.tensorflow_stub.pywrap_tensorflow import masked_crc32c as of_tensorboard

from learner.run.crc32c import masked_crc32c


@given(st.binary(max_size=300))
def test_it_is_the_checksum_that_tensorboard_computes(data):
    assert masked_crc32c(data) == of_tensorboard(data)


def test_the_published_example():
    """RFC 3720, B.4: 32 bytes of zeros have the CRC 8A9136AA."""
    crc = 0x8A9136AA
    assert masked_crc32c(bytes(32)) == (((crc >> 15 | crc << 17) & 0xFFFFFFFF) + 0xA282EAD8) & 0xFFFFFFFF
