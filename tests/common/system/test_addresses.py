"""Which addresses to listen at are understood, and which are free."""

import socket

import pytest

from common.errors import ConfigError
from common.system.addresses import check_free, listening_address


def test_a_port_alone_is_open_to_this_machine_only():
    assert listening_address("9100", "--metrics") == ("127.0.0.1", 9100)
    assert listening_address("0.0.0.0:9100", "--metrics") == ("0.0.0.0", 9100)
    assert listening_address("[::]:9100", "--metrics") == ("::", 9100)


@pytest.mark.parametrize("wrong", ["", "host", "host:", "99999", "-1", "host:port", "::1"])
def test_anything_else_is_refused_by_the_name_of_its_option(wrong):
    with pytest.raises(ConfigError, match=r"^--metrics must be PORT or HOST:PORT, such as 8080"):
        listening_address(wrong, "--metrics")


def test_a_port_that_is_taken_is_told_with_its_option():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        words = f"^--page cannot listen on 127.0.0.1:{port}: Address already in use: give another port or host$"
        with pytest.raises(ConfigError, match=words):
            check_free("127.0.0.1", port, "--page")
    check_free("127.0.0.1", port, "--page")
    with pytest.raises(ConfigError, match=r"--page cannot listen on 203\.0\.113\.7:80: "):
        check_free("203.0.113.7", 80, "--page")


def test_a_port_of_any_number_is_free():
    check_free("127.0.0.1", 0, "--page")
