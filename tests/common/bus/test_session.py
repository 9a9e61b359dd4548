import logging
import socket
import time
from contextlib import ExitStack

import pytest

from common.bus.endpoint import is_loopback, require_free
from common.bus.query import QueryServer
from common.bus.session import open_client_session, open_learner_session
from common.bus.spec import SpecServer, fetch_spec, list_runs
from common.config import BusConfig
from common.errors import BusError, MessageError
from common.messages.codec import pack
from common.messages.replies import Spec
from tests.common.bus.processes import free_port, loopback


def test_an_actor_may_start_before_its_learner():
    config = loopback()
    with open_client_session(config) as client, open_learner_session(config) as learner:
        server = SpecServer(learner, Spec("office", 5, '{"seed": 3}'))
        assert fetch_spec(client, "office", timeout=5).config == '{"seed": 3}'
        server.close()


def test_runs_on_the_bus_are_listed():
    config = loopback()
    with open_learner_session(config) as learner, open_client_session(config) as client:
        assert list_runs(client, timeout=0.3) == []
        with SpecServer(learner, Spec("b", 1, "{}")), SpecServer(learner, Spec("a", 2, "{}")):
            assert [spec.run for spec in list_runs(client, timeout=5)] == ["a", "b"]


def test_a_run_of_another_release_is_not_called_missing():
    def answer(query):
        query.reply("hd/b/spec", pack({"v": 9, "kind": "spec"}))

    config = loopback()
    with open_learner_session(config) as learner, open_client_session(config) as client, ExitStack() as stack:
        stack.enter_context(QueryServer(learner, "hd/b/spec", answer))
        with pytest.raises(MessageError, match="the sender has a newer release"):
            list_runs(client, timeout=5)
        with SpecServer(learner, Spec("a", 2, "{}")):
            assert [spec.run for spec in list_runs(client, timeout=5)] == ["a"]


def opened(config):
    """Open the learner's session and close it again."""
    with open_learner_session(config):
        pass


def test_a_missing_learner_is_reported_with_what_to_check():
    expected = "no learner of the run 'office' answered within 0.3 s"
    with open_client_session(loopback()) as client, pytest.raises(BusError, match=expected):
        fetch_spec(client, "office", timeout=0.3)


def test_a_second_learner_on_the_same_port_is_told_so():
    config = loopback()
    with open_learner_session(config), pytest.raises(BusError, match="in use by another process"):
        opened(config)


@pytest.mark.parametrize(
    "endpoint", ["127.0.0.1:7447", "tcp/127.0.0.1", "tcp/:80", "tcp/h:70000", "udp/h:1", "", "tcp/h:x"]
)
def test_malformed_endpoints_are_refused(endpoint):
    for setting in ({"listen": endpoint}, {"connect": [endpoint]}):
        with pytest.raises(ValueError, match="an endpoint must be"):
            BusConfig(**setting)
    with pytest.raises(BusError, match="an endpoint must be"):
        open_client_session(BusConfig(), [endpoint])


def test_a_port_is_known_to_be_taken_before_anything_is_prepared():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(BusError, match="in use by another process"):
            require_free(["unixsock-stream//tmp/socket", endpoint])
    require_free([endpoint, "tcp/[::1]:0?rel=1"])
    with pytest.raises(BusError, match="no address"):
        require_free(["tcp/192.0.2.1:7447"])


def test_an_endpoint_is_needed():
    with pytest.raises(BusError, match="is needed"):
        open_client_session(BusConfig(), [])


def test_foreign_addresses_are_refused():
    with pytest.raises(BusError, match="no address"):
        opened(BusConfig(listen=f"tcp/192.0.2.1:{free_port()}"))


def test_an_error_of_zenoh_names_no_place_in_its_source():
    config = BusConfig(listen="unixsock-stream//no/such/folder/socket")
    with pytest.raises(BusError, match="cannot listen on unixsock-stream") as error, open_learner_session(config):
        pass
    assert "No such file" in str(error.value) and ".rs" not in str(error.value)


def test_connections_that_say_nothing_keep_nobody_out():
    config = loopback()
    port = int(config.listen.rsplit(":", 1)[1])
    with open_learner_session(config) as learner, SpecServer(learner, Spec("office", 1, "{}")), ExitStack() as stack:
        for _ in range(300):
            stack.enter_context(socket.create_connection(("127.0.0.1", port), 5.0))
        time.sleep(0.5)
        began = time.monotonic()
        with open_client_session(config) as client:
            assert fetch_spec(client, "office", timeout=20.0).run == "office"
        assert time.monotonic() - began < 5.0


def test_listening_beyond_loopback_without_tls_warns(caplog):
    with caplog.at_level(logging.WARNING), open_learner_session(BusConfig(listen=f"tcp/0.0.0.0:{free_port()}")):
        assert "without TLS" in caplog.text
    caplog.clear()
    with open_learner_session(loopback()):
        assert not caplog.text


def test_tls_files_must_exist():
    files = {"tls_ca": "no/ca.pem", "tls_certificate": "no/a.pem", "tls_key": "no/a.key"}
    with pytest.raises(BusError, match="tls_ca: no file 'no/ca.pem'"):
        open_client_session(BusConfig(**files))
    with pytest.raises(BusError, match="needs certificates"):
        open_client_session(BusConfig(), ["tls/127.0.0.1:7447"])
    with pytest.raises(BusError, match="tls_access needs"):
        opened(BusConfig(listen=f"tcp/127.0.0.1:{free_port()}", tls_access="access.json"))


@pytest.mark.parametrize(
    ("endpoint", "expected"),
    [
        ("tcp/127.0.0.1:1", True),
        ("tcp/127.9.9.9:1", True),
        ("tls/localhost:1", True),
        ("tcp/[::1]:1", True),
        ("unixsock-stream/tmp/x", True),
        ("tcp/0.0.0.0:1", False),
        ("tcp/[::]:1", False),
        ("tcp/192.168.0.2:1", False),
        ("tcp/gpu-host:1", False),
    ],
)
def test_loopback(endpoint, expected):
    assert is_loopback(endpoint) is expected


def test_an_actor_reaches_the_learner_through_another_router():
    router, learner_side = loopback(), loopback()
    learner_config = learner_side.model_copy(update={"connect": (router.listen,)})
    with (
        open_learner_session(router),
        open_learner_session(learner_config) as learner,
        SpecServer(learner, Spec("office", 5, "{}")),
        open_client_session(BusConfig(), [router.listen]) as client,
    ):
        assert fetch_spec(client, "office", timeout=10).learner == 5


def test_shared_memory_can_be_switched_on():
    config = loopback(shared_memory=True)
    large = '{"text": "' + "x" * 100_000 + '"}'
    with (
        open_learner_session(config) as learner,
        SpecServer(learner, Spec("office", 5, large)),
        open_client_session(config) as client,
    ):
        assert fetch_spec(client, "office", timeout=10).config == large


def test_a_unix_socket_serves_one_machine(tmp_path):
    config = BusConfig(listen=f"unixsock-stream/{tmp_path / 'bus'}")
    with (
        open_learner_session(config) as learner,
        SpecServer(learner, Spec("office", 5, "{}")),
        open_client_session(config) as client,
    ):
        assert fetch_spec(client, "office", timeout=10).learner == 5
