"""TLS on the robot's network: who has no certificate is nobody."""

import json

import pytest
import trustme

from common.errors import BusError
from deploy.network_config import RosConfig
from deploy.ros2 import Node, RosError, message
from deploy.ros2.session import open_session
from tests.common.bus.processes import eventually, free_port

STRING = "std_msgs/msg/String"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A function that returns the TLS settings of a name, by one authority."""
    folder = tmp_path_factory.mktemp("pki")
    authority = trustme.CA()
    authority.cert_pem.write_to_path(folder / "ca.pem")

    def of(name):
        issued = authority.issue_cert("127.0.0.1", common_name=name)
        issued.cert_chain_pems[0].write_to_path(folder / f"{name}.pem")
        issued.private_key_pem.write_to_path(folder / f"{name}.key")
        return {
            "tls_ca": str(folder / "ca.pem"),
            "tls_certificate": str(folder / f"{name}.pem"),
            "tls_key": str(folder / f"{name}.key"),
        }

    return of


def heard_by(node, topic):
    heard = []
    node.subscribe(topic, STRING, lambda said, received: heard.append(said.data))
    return heard


def test_nodes_with_certificates_hear_each_other_and_nobody_else_is_heard(files):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        Node(RosConfig(listen=(endpoint,), connect=(), **files("robot")), "robot") as robot,
        Node(RosConfig(connect=(endpoint,), **files("bridge")), "bridge") as bridge,
        Node(RosConfig(connect=(endpoint,), mode="peer"), "stranger") as stranger,
    ):
        heard = heard_by(robot, "/hd/command")
        friend, foe = bridge.publisher("/hd/command", STRING), stranger.publisher("/hd/command", STRING)

        def say():
            foe.publish(message(STRING, data="foe"))
            friend.publish(message(STRING, data="friend"))
            return heard

        assert eventually(say)
        assert set(heard) == {"friend"}


def test_access_rules_say_who_may_publish_what(files, tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    rules = {
        "enabled": True,
        "default_permission": "allow",
        "rules": [
            {
                "id": "no commands",
                "permission": "deny",
                "flows": ["ingress"],
                "messages": ["put"],
                "key_exprs": ["0/hd/command/**"],
            }
        ],
        "subjects": [{"id": "camera", "cert_common_names": ["camera"]}],
        "policies": [{"rules": ["no commands"], "subjects": ["camera"]}],
    }
    access = tmp_path / "access.json"
    access.write_text(json.dumps(rules))
    with (
        Node(RosConfig(listen=(endpoint,), connect=(), tls_access=str(access), **files("robot")), "robot") as robot,
        Node(RosConfig(connect=(endpoint,), mode="client", **files("operator")), "operator") as operator,
        Node(RosConfig(connect=(endpoint,), mode="client", **files("camera")), "camera") as camera,
    ):
        commands, pictures = heard_by(robot, "/hd/command"), heard_by(robot, "/pictures")
        by_topic = [
            (node.publisher("/hd/command", STRING), node.publisher("/pictures", STRING), node.name)
            for node in (operator, camera)
        ]

        def say():
            for command, picture, name in by_topic:
                command.publish(message(STRING, data=name))
                picture.publish(message(STRING, data=name))
            return "operator" in commands and {"operator", "camera"} <= set(pictures)

        assert eventually(say)
        assert set(commands) == {"operator"}


def test_listening_on_the_network_without_tls_is_warned_of(files, caplog):
    port = free_port()
    open_session(RosConfig(listen=(f"tcp/127.0.0.1:{port}",), connect=())).close()
    open_session(RosConfig(listen=(f"tcp/0.0.0.0:{port}",), connect=(), **files("robot"))).close()
    assert "without TLS" not in caplog.text
    open_session(RosConfig(listen=(f"tcp/0.0.0.0:{port}",), connect=())).close()
    assert f"listening on tcp/0.0.0.0:{port} without TLS: anyone who can reach this address can command" in caplog.text


def test_missing_files_and_endpoints_are_named():
    with pytest.raises(BusError, match="tls_ca: no file '/nowhere/ca.pem'"):
        open_session(RosConfig(tls_ca="/nowhere/ca.pem"))
    # As options of commands give it, past the validation of the settings.
    with pytest.raises(RosError, match=r"must be tcp/HOST:PORT.*, got '127.0.0.1'"):
        open_session(RosConfig().model_copy(update={"connect": ("127.0.0.1",)}))
