import contextlib
import struct

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from common.errors import MessageError
from common.messages.codec import DTYPES, MAX_DEPTH, MAX_ITEMS, pack, pack_array, unpack

ARRAYS = st.sampled_from([dtype.name for dtype in DTYPES]).flatmap(
    lambda name: hnp.arrays(np.dtype(name), hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=5))
)
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats(allow_nan=False)
    | st.text(max_size=50)
    | st.binary(max_size=300)
)
NAMES = st.text(min_size=1, max_size=12)
FIELDS = st.dictionaries(NAMES, SCALARS | st.dictionaries(NAMES, SCALARS, max_size=20), max_size=20)


@given(FIELDS)
def test_what_is_packed_comes_back(fields):
    assert unpack(pack(fields)) == fields


@given(FIELDS)
def test_reading_agrees_with_the_msgpack_library(fields):
    data = msgpack.packb(fields, use_bin_type=True)
    assert unpack(data) == msgpack.unpackb(data, strict_map_key=False)


@given(ARRAYS)
def test_arrays_come_back_with_dtype_and_shape(array):
    back = unpack(pack({"a": array}))["a"]
    assert back.dtype == array.dtype
    assert back.shape == array.shape
    assert back.tobytes() == array.tobytes()
    assert back.flags.owndata or back.base.flags.owndata
    assert back.flags.writeable
    assert back.flags.aligned


@pytest.mark.parametrize("order", ["<", ">"])
def test_arrays_travel_in_little_endian_c_order_whatever_the_sender_holds(order):
    array = np.asfortranarray(np.arange(6, dtype=f"{order}i2").reshape(2, 3))
    assert pack_array(array) == bytes([2, 2]) + struct.pack("<2I6h", 2, 3, 0, 1, 2, 3, 4, 5)
    np.testing.assert_array_equal(unpack(pack({"a": array}))["a"], array)


def array_bytes(payload: bytes) -> bytes:
    return msgpack.packb({"a": msgpack.ExtType(1, payload)})


ARRAY = pack_array(np.arange(4, dtype=np.int32))
NESTED = b"\x81\xa1a" * (MAX_DEPTH + 1) + b"\xc0"
DEEP = b"\x81\xa1a" * 100_000


@pytest.mark.parametrize(
    ("data", "field", "words"),
    [
        (b"", "message", "only 0 are left"),
        (b"\xc0", "message", "must be a map"),
        (b"\x81\xa1a", "message.a", "only 0 are left"),
        (b"\x82\xa1a\x01\xa1a\x02", "message.a", "is duplicated"),
        (b"\x81\x01\x01", "message", "text as names"),
        (b"\x80\x00", "message", "must end after 1 bytes"),
        (b"\x81\xa1a\x91\x01", "message.a", "tag 0x91"),
        (b"\x81\xa1a\xc1", "message.a", "tag 0xc1"),
        (b"\x81\xa1a\xdd\xff\xff\xff\xff", "message.a", "tag 0xdd"),
        (b"\xdf\xff\xff\xff\xff", "message", "at most 4096 entries"),
        (b"\x81\xa1a\xdb\xff\xff\xff\xff", "message.a", "bytes of text"),
        (b"\x81\xa1a\xc6\xff\xff\xff\xff", "message.a", "needs 4294967295 bytes"),
        (b"\x81\xa1a\xc9\xff\xff\xff\xff\x01\x00\x00", "message.a", "needs 4294967295 bytes"),
        (b"\x81\xa1a\xd9\x02\xff\xfe", "message.a", "UTF-8"),
        (b"\x81\xd9\xffa", "message", "needs 255 bytes"),
        (NESTED, "message" + ".a" * MAX_DEPTH, "nested deeper"),
        (DEEP, "message" + ".a" * MAX_DEPTH, "nested deeper"),
        (array_bytes(b""), "message.a", "array header"),
        (array_bytes(b"\x0c\x01\x00\x00\x00\x00"), "message.a", "unknown dtype code 12"),
        (array_bytes(b"\x01\x04" + bytes(16)), "message.a", "at most 3 dimensions"),
        (array_bytes(b"\x01\x03" + bytes(11)), "message.a", "within its 3 dimensions"),
        (array_bytes(ARRAY[:-1]), "message.a", "needs 16 bytes, got 15"),
        (array_bytes(ARRAY + b"\x00"), "message.a", "needs 16 bytes, got 17"),
        (array_bytes(b"\x01\x02" + b"\xff" * 8), "message.a", "needs 18446744065119617025 bytes"),
        (array_bytes(b"\x01\x02" + bytes(4) + b"\xff" * 4), "message.a", "no elements"),
        (array_bytes(b"\x00\x01\x01\x00\x00\x00\x02"), "message.a", "booleans as 0 or 1"),
        (msgpack.packb({"a": msgpack.ExtType(2, ARRAY)}), "message.a", "extension 2"),
        (msgpack.packb({"a": msgpack.Timestamp(1)}), "message.a", "extension 255"),
    ],
)
def test_hostile_bytes_are_refused_by_name(data, field, words):
    with pytest.raises(MessageError, match=words) as caught:
        unpack(data)
    assert caught.value.field == field


def test_the_number_of_items_is_bounded():
    many = {f"m{i}": {f"{j}": None for j in range(1000)} for i in range(MAX_ITEMS // 1000 + 1)}
    with pytest.raises(MessageError, match="items"):
        unpack(msgpack.packb(many))


def test_the_length_of_a_message_is_bounded():
    with pytest.raises(MessageError, match="at most 10 bytes, got 13"):
        unpack(pack({"a": b"12345678"}), max_bytes=10)


@given(st.binary(max_size=200))
def test_random_bytes_never_raise_anything_else(data):
    with contextlib.suppress(MessageError):
        unpack(b"\x81\xa1a" + data)


@pytest.mark.parametrize("value", [object(), np.zeros(1, dtype=np.complex64), np.zeros((1, 1, 1, 1)), np.float32(1)])
def test_what_no_message_can_hold_is_refused_when_packing(value):
    with pytest.raises(TypeError, match="no message can hold"):
        pack({"a": value})
