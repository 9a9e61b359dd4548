"""Which addresses to listen at are understood."""

import pytest

from common.errors import ConfigError
from common.system.addresses import listening_address


def test_a_port_alone_is_open_to_this_machine_only():
    assert listening_address("9100", "--metrics") == ("127.0.0.1", 9100)
    assert listening_address("0.0.0.0:9100", "--metrics") == ("0.0.0.0", 9100)
    assert listening_address("[::]:9100", "--metrics") == ("::", 9100)


@pytest.mark.parametrize("wrong", ["", "host", "host:", "99999", "-1", "host:port", "::1"])
def test_anything_else_is_refused_by_the_name_of_its_option(wrong):
    with pytest.raises(ConfigError, match=r"^--metrics must be PORT or HOST:PORT, such as 8080"):
        listening_address(wrong, "--metrics")
