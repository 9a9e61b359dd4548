"""An actor written from docs/bus.md alone: Zenoh, a plain msgpack library, and nothing of ours."""

import hashlib
import json
import re
import struct
from pathlib import Path

import msgpack
import zenoh

from common.bus.experience import ExperienceServer
from common.bus.session import open_learner_session
from common.bus.spec import SpecServer
from common.bus.weights import WeightsPublisher
from common.messages.replies import Spec
from tests.common.bus.processes import eventually, loopback
from tests.common.messages import samples

PAGE = (Path(__file__).parents[3] / "docs" / "bus.md").read_text("utf-8")
FORMATS = {0: "?", 1: "b", 2: "h", 3: "i", 4: "q", 5: "B", 6: "H", 7: "I", 8: "Q", 9: "e", 10: "f", 11: "d"}


def array(code: int, *values, shape=None) -> msgpack.ExtType:
    shape = (len(values),) if shape is None else shape
    header = struct.pack(f"<BB{len(shape)}I", code, len(shape), *shape)
    return msgpack.ExtType(1, header + struct.pack(f"<{len(values)}{FORMATS[code]}", *values))


def query(session: zenoh.Session, selector: str, payload: bytes | None = None) -> dict:
    answers = []

    def asked() -> bool:
        answers.extend(session.get(selector, payload=payload, timeout=3, consolidation=zenoh.ConsolidationMode.NONE))
        return bool(answers)

    assert eventually(asked)
    return msgpack.unpackb(answers[0].result.payload.to_bytes())


def chunk() -> dict:
    return {
        "kind": "chunk",
        "episode": 0,
        "first_step": 0,
        "family": 0,
        "end": 0,
        "observations": {
            "count": array(3, 2),
            "offsets": array(2, 0, 0, 64, 0, shape=(2, 2)),
            "utility": array(6, 0, 5),
            "visited": array(0, True, False),
            "beacon": array(0, False, True),
            "degree": array(5, 1, 0),
            "edge_count": array(3, 1),
            "neighbours": array(6, 1),
            "bent_count": array(3, 1),
            "bent": array(7, 0),
            "bent_length": array(10, 1.25),
            "robot": array(3, 0),
            "has_target": array(0, False),
            "target_known": array(0, False),
            "target_offset": array(10, 0, 0, shape=(1, 2)),
            "link_count": array(3, 0),
            "target_links": array(6),
            "cell": array(10, 0.0625),
            "reach": array(10, 5.0),
            "route_count": array(3, 1),
            "route": array(6, 1),
        },
        "beacons": array(3, 1),
        "waypoints": array(3, 1),
        "rewards": array(10, 0.5),
        "versions": array(4, 3),
        "probabilities": array(10, 0.25),
        "labels": None,
    }


def test_an_actor_in_another_language_can_take_part():
    listen = loopback()
    stored = []
    settings = {
        "mode": "peer",
        "listen": {"endpoints": []},
        "connect": {"endpoints": [listen.listen], "timeout_ms": -1, "exit_on_failure": False},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    }
    with (
        open_learner_session(listen) as learner,
        SpecServer(learner, Spec("office", 815, '{"seed": 3}')),
        WeightsPublisher(learner, "office") as publisher,
        ExperienceServer(learner, "office", 815, lambda delivery, payload: stored.append(delivery) or 0.5),
        zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session,
    ):
        publisher.publish(samples.weights(version=7))
        spec = query(session, "hd/office/spec")
        assert (spec["v"], spec["kind"], json.loads(spec["config"])) == (3, "spec", {"seed": 3})

        weights = query(session, "hd/office/weights/latest?averaged=0")
        digest = hashlib.sha256()
        for name in sorted(weights["tensors"], key=str.encode):
            digest.update(name.encode() + b"\0" + weights["tensors"][name].data)
        assert digest.hexdigest() == weights["digest"]
        notice = query(session, f"hd/office/weights/latest?averaged=0;have={weights['learner']}:{weights['version']}")
        assert (notice["kind"], notice["version"]) == ("weights_notice", 7)

        message = {"v": 3, "kind": "delivery", "actor": "desk-0", "incarnation": 4711, "sequence": 0, "body": chunk()}
        data = msgpack.packb(message)
        assert data == bytes.fromhex(re.search(r"```hex delivery\n(.*?)\n```", PAGE, re.DOTALL)[1])
        ack = query(session, "hd/office/experience/desk-0", data)
        assert (ack["kind"], ack["sequence"], ack["stored"], ack["hold"], ack["learner"]) == ("ack", 0, True, 0.5, 815)
        assert stored[0].body.rewards[0] == 0.5

        message["body"]["waypoints"] = array(3, 0)
        refused = query(session, "hd/office/experience/desk-0", msgpack.packb(message | {"sequence": 1}))
        assert refused["error"].startswith("delivery.body.waypoints: must be neighbours of the robot")
        assert len(stored) == 1
