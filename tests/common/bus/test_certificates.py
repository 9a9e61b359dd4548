"""What is wrong with the files of mutual TLS is told before others refuse them in silence."""

import datetime

import pytest
import trustme

from common.bus.certificates import check_certificate
from common.bus.session import open_client_session
from common.config import BusConfig
from common.errors import BusError


@pytest.fixture(scope="module")
def authority():
    return trustme.CA()


def write(folder, authority, **validity):
    """Write the three files of a process and return their paths."""
    issued = authority.issue_cert("desk", common_name="desk", **validity)
    names = [str(folder / name) for name in ("ca.pem", "desk.pem", "desk.key")]
    authority.cert_pem.write_to_path(names[0])
    issued.cert_chain_pems[0].write_to_path(names[1])
    issued.private_key_pem.write_to_path(names[2])
    return names


def days(number):
    return datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=number)


def test_right_files_are_right(tmp_path, authority, caplog):
    check_certificate(*write(tmp_path, authority))
    assert not caplog.records


def test_an_expired_certificate_opens_no_session(tmp_path, authority):
    ca, certificate, key = write(tmp_path, authority, not_before=days(-9), not_after=days(-1))
    bus = BusConfig(listen="tls/127.0.0.1:7447", tls_ca=ca, tls_certificate=certificate, tls_key=key)
    with pytest.raises(BusError, match=r"desk\.pem.* has expired: remove it"):
        open_client_session(bus)


def test_one_that_is_not_valid_yet_waits_for_the_clock(tmp_path, authority, caplog):
    check_certificate(*write(tmp_path, authority, not_before=days(1), not_after=days(9)))
    assert "not valid yet" in caplog.text


def test_files_that_do_not_belong_together_are_named(tmp_path, authority):
    (tmp_path / "other").mkdir()
    ca, certificate, key = write(tmp_path, authority)
    other = write(tmp_path / "other", trustme.CA())
    with pytest.raises(BusError, match="was not issued by the authority"):
        check_certificate(other[0], certificate, key)
    for pair in ((certificate, other[2]), (key, certificate), (ca, ca)):
        with pytest.raises(BusError, match="no certificate and its private key"):
            check_certificate(ca, *pair)
    with pytest.raises(BusError, match="tls_ca.*no certificate"):
        check_certificate(key, certificate, key)
