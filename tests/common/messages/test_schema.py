import dataclasses
import json

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.errors import MessageError
from common.messages.codec import pack, unpack
from common.messages.experience import Delivery, End
from common.messages.replies import Ack, ControlReply, ControlRequest, Spec
from common.messages.schema import decode, encode
from common.messages.stats import ActorStats
from common.messages.weights import Weights, WeightsNotice
from common.system.printable import is_printable
from tests.common.messages import samples


def equal(a, b) -> bool:
    """Compare messages with arrays in them."""
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(
            equal(getattr(a, field.name), getattr(b, field.name)) for field in dataclasses.fields(a)
        )
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[name], b[name]) for name in a)
    return a == b and type(a) is type(b)


def change(message: object, path: str, value: object) -> bytes:
    """Encode a message with one field replaced, or removed when the value is `...`."""
    fields = unpack(encode(message), max_bytes=1 << 26)
    inner = fields
    *parents, name = path.split(".")
    for parent in parents:
        inner = inner[parent]
    if value is ...:
        del inner[name]
    else:
        inner[name] = value
    return pack(fields)


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 5),
    st.sampled_from(End),
    st.booleans(),
    st.integers(0, 2**53 - 1),
    st.integers(0, 2**63 - 1),
)
@settings(max_examples=40, deadline=None)
def test_chunks_come_back_unchanged(seed, steps, end, labels, sequence, incarnation):
    rng = np.random.default_rng(seed)
    sent = samples.delivery(rng, sequence, incarnation=incarnation, steps=steps, end=end, labels=labels)
    assert equal(decode(encode(sent), Delivery), sent)


def test_images_travel_only_where_there_are_some():
    """A column that no other network asks for costs no other message a byte."""
    sent = samples.delivery(np.random.default_rng(0), 1, steps=3, end=End.TERMINAL)
    columns = unpack(encode(sent), max_bytes=1 << 26)["body"]["observations"]
    assert "image" not in columns
    images = np.random.default_rng(1).integers(0, 256, (4, 2, 48 * 48)).astype(np.uint8)
    observations = dataclasses.replace(sent.body.observations, image=images)
    with_images = dataclasses.replace(sent, body=dataclasses.replace(sent.body, observations=observations))
    assert equal(decode(encode(with_images), Delivery), with_images)
    for wrong in (images[:3], images[:, :1], images.astype(np.int8), None):
        with pytest.raises(MessageError, match=r"observations\.image: must be"):
            decode(change(with_images, "body.observations.image", wrong), Delivery)


@given(
    st.builds(
        samples.report,
        map_name=st.text(max_size=256).filter(is_printable),
        distance=st.floats(0, 1e7),
        version=st.integers(-1, 9),
    )
)
def test_reports_come_back_unchanged(report):
    sent = Delivery("desk-0", 1, 2, report)
    assert equal(decode(encode(sent), Delivery), sent)


@pytest.mark.parametrize("message", samples.small_messages(), ids=lambda message: type(message).__name__)
def test_small_messages_come_back_unchanged(message):
    assert equal(decode(encode(message), type(message)), message)


@pytest.mark.parametrize("dtype", ["float16", "float32", "float64"])
def test_weights_come_back_unchanged(dtype):
    tensors = {"a.b": np.arange(6, dtype=dtype).reshape(2, 3), "ä": np.zeros((), dtype=dtype)}
    sent = Weights.of(tensors, learner=5, version=3, updates=30, averaged=True)
    assert equal(decode(encode(sent), Weights), sent)


def test_one_of_two_expected_kinds_may_come():
    assert isinstance(decode(encode(samples.weights().notice()), Weights, WeightsNotice), WeightsNotice)
    assert isinstance(decode(encode(samples.weights()), Weights, WeightsNotice), Weights)
    with pytest.raises(MessageError, match="must be one of weights, weights_notice, got 'spec'"):
        decode(encode(Spec("a", 1, "{}")), Weights, WeightsNotice)


@pytest.mark.parametrize("message", [*samples.small_messages(), samples.weights()], ids=lambda m: type(m).__name__)
def test_every_field_is_required_and_no_other_is_allowed(message):
    expected = type(message)
    # What an earlier release of the same protocol does not send.
    optional = {"restarts": 0, "last_error": ""} if expected is ActorStats else {}
    for name in unpack(encode(message)):
        if name in optional:
            assert getattr(decode(change(message, name, ...), expected), name) == optional[name]
            continue
        with pytest.raises(MessageError) as caught:
            decode(change(message, name, ...), expected)
        assert caught.value.field.endswith(f".{name}")
    with pytest.raises(MessageError, match=r"\.extra: is no field"):
        decode(change(message, "extra", 1), expected)


@pytest.mark.parametrize("version", [0, 2, 4, "3", None, True, 3.0])
def test_other_protocol_versions_are_refused(version):
    with pytest.raises(MessageError) as caught:
        decode(change(Ack(1, True, 0.0, "", 1), "v", version), Ack)
    assert caught.value.field == "ack.v"


ACK, SPEC = Ack(1, True, 0.0, "", 1), Spec("office", 1, "{}")
STATS = samples.small_messages()[3]
NOTICE = samples.weights().notice()
NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("message", "field", "value"),
    [
        (ACK, "sequence", -2),
        (ACK, "sequence", 2**53),
        (ACK, "sequence", 1.0),
        (ACK, "sequence", True),
        (ACK, "stored", 1),
        (ACK, "hold", NAN),
        (ACK, "hold", INF),
        (ACK, "hold", -0.5),
        (ACK, "hold", 1e9),
        (ACK, "error", b"bytes"),
        (ACK, "error", "x" * 1001),
        (ACK, "learner", -1),
        (SPEC, "run", "a/b"),
        (SPEC, "run", "**"),
        (SPEC, "run", ""),
        (SPEC, "config", "not json"),
        (SPEC, "config", "[1]"),
        (SPEC, "config", "[" * 100_000),
        (SPEC, "config", '{"a": NaN}'),
        (STATS, "steps_per_second", INF),
        (STATS, "actor", "Desk"),
        (STATS, "pid", None),
        (NOTICE, "digest", "0" * 63),
        (NOTICE, "digest", "G" * 64),
        (NOTICE, "bytes", 2**40),
        (ControlRequest("stop"), "verb", "explode"),
        (ControlRequest("stop"), "arguments", "1"),
        (ControlReply(True, "", {}), "ok", "yes"),
        (ControlRequest("stop"), "arguments", '{"x": 1e999}'),
        (ControlRequest("stop"), "arguments", '{"x": ' + "[" * 40 + "]" * 40 + "}"),
        (SPEC, "config", '{"a": -1e999}'),
        (STATS, "pid", 2**40),
        (STATS, "steps_per_second", 1e11),
        (STATS, "version_age", 1e11),
        (STATS, "host", "desk\x1b[2J"),
        (STATS, "state", "acting\nlearner | all is well"),
        (STATS, "state", "acting\x9b31m"),
        (STATS, "state", "acting \u202e"),
    ],
)
def test_bad_values_are_refused_by_name(message, field, value):
    with pytest.raises(MessageError) as caught:
        decode(change(message, field, value), type(message))
    assert caught.value.field.split(".")[1] == field


DELIVERY = samples.delivery(np.random.default_rng(1), steps=3, end=End.TERMINAL)
N = len(DELIVERY.body.observations.utility)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("actor", "../x"),
        ("incarnation", 2**63),
        ("sequence", -1),
        ("body", None),
        ("body.kind", "pickle"),
        ("body.episode", -1),
        ("body.first_step", -1),
        ("body.end", 3),
        ("body.rewards", np.array([0, np.nan, 0], dtype=np.float32)),
        ("body.rewards", np.zeros(3, dtype=np.float64)),
        ("body.rewards", np.zeros((3, 1), dtype=np.float32)),
        ("body.rewards", np.zeros(0, dtype=np.float32)),
        ("body.rewards", [0.0, 0.0]),
        ("body.beacons", np.zeros(2, dtype=np.int32)),
        ("body.waypoints", np.zeros(3, dtype=np.int64)),
        ("body.versions", np.array([0, -2, 0], dtype=np.int64)),
        ("body.probabilities", np.zeros(2, dtype=np.float32)),
        ("body.probabilities", np.array([0.5, 1.5, 0.5], dtype=np.float32)),
        ("body.probabilities", np.array([0.5, np.nan, 0.5], dtype=np.float32)),
        ("body.family", -1),
        ("body.family", 256),
        ("body.observations", None),
        ("body.observations.count", np.zeros(3, dtype=np.int32)),
        ("body.observations.count", np.array([1, 1, 1, 2**31 - 1], dtype=np.int32)),
        ("body.observations.utility", np.zeros(0, dtype=np.uint16)),
        ("body.observations.offsets", np.zeros((N, 3), dtype=np.int16)),
        ("body.observations.visited", np.zeros(N, dtype=np.uint8)),
        ("body.observations.degree", np.zeros(N, dtype=np.uint16)),
        ("body.observations.neighbours", np.zeros(0, dtype=np.uint16)),
        ("body.observations.neighbours", np.zeros(5, dtype=np.uint32)),
        ("body.observations.bent", np.zeros((2, 2), dtype=np.uint32)),
        ("body.observations.bent_length", np.zeros(0, dtype=np.float64)),
        ("body.labels.cost", np.zeros(0, dtype=np.float32)),
        ("body.labels.cost", DELIVERY.body.labels.cost * np.float32(np.inf)),
        ("body.labels.cost", -1 - DELIVERY.body.labels.cost),
        ("body.labels.remaining", np.array([1.0, np.inf, 1.0], dtype=np.float32)),
        ("body.labels.remaining", np.array([1.0, 2.0, 1.0], dtype=np.float64)),
        ("body.labels.unseen", np.array([1.0, -1.0, 1.0], dtype=np.float32)),
        ("body.labels.extra", 1),
        ("body.rewards", np.array([0, 3e38, 0], dtype=np.float32)),
        ("body.rewards", np.array([0, -2e6, 0], dtype=np.float32)),
        ("body.versions", np.array([0, 2**60, 0], dtype=np.int64)),
        ("body.probabilities", np.array([0.5, 1e-40, 0.5], dtype=np.float32)),
        ("body.labels.cost", DELIVERY.body.labels.cost + np.float32(3e38)),
        ("body.labels.remaining", np.array([1.0, 2e6, 1.0], dtype=np.float32)),
        ("body.labels.unseen", np.array([1.0, 3e38, 1.0], dtype=np.float32)),
    ],
)
def test_bad_deliveries_are_refused_by_name(field, value):
    packable = value if not isinstance(value, list) else {"0": value[0]}
    with pytest.raises(MessageError) as caught:
        decode(change(DELIVERY, field, packable), Delivery)
    named = caught.value.field
    # A change of the number of steps or viewpoints may show at a column that depends on it.
    assert named == f"delivery.{field}" or (hasattr(value, "shape") and named.startswith("delivery.body"))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("distance", 1e9),
        ("reward", 1e12),
        ("collisions", 2**50),
        ("duration", 1e9),
        ("classical_distance", 1e-300),
        ("classical_distance", 1e9),
        ("map_name", "rooms\x1b]0;owned\x07"),
        ("driver", "policy\x1b[1A"),
        ("simulator", "grid\r"),
    ],
)
def test_bad_reports_are_refused_by_name(field, value):
    with pytest.raises(MessageError) as caught:
        decode(change(Delivery("desk-0", 1, 2, samples.report()), f"body.{field}", value), Delivery)
    assert caught.value.field == f"delivery.body.{field}"


def test_texts_for_people_reach_no_terminal_raw():
    reply = decode(encode(ControlReply(False, "no\x1b[2J", {"state": "a\x1b[31m", "\x07": ["\x9b1A"]})), ControlReply)
    assert reply == ControlReply(False, "no\\x1b[2J", {"state": "a\\x1b[31m", "\\x07": ["\\x9b1A"]})
    assert decode(encode(Ack(1, False, 0.0, "\x1b" * 1000, 1)), Ack).error == ("\\x1b" * 1000)[:1000]


def test_weights_must_match_their_digest_and_be_finite_floats():
    weights = samples.weights()
    with pytest.raises(MessageError, match="digest: must be that of the tensors"):
        decode(change(weights, "tensors", {"encoder.bias": np.zeros(8, dtype=np.float32)}), Weights)
    with pytest.raises(MessageError, match=r"tensors\.encoder\.bias: must be finite"):
        decode(encode(dataclasses.replace(weights, tensors={"encoder.bias": np.full(8, np.nan, np.float32)})), Weights)
    with pytest.raises(MessageError, match=r"tensors\.encoder\.bias: must be finite"):
        decode(
            encode(Weights.of({"encoder.bias": np.full(8, 3e38, np.float32)}, learner=1, version=1, updates=1)), Weights
        )
    with pytest.raises(MessageError, match=r"tensors\.x: must be an array of float16"):
        decode(change(weights, "tensors", {"x": np.zeros(2, dtype=np.int32)}), Weights)
    with pytest.raises(TypeError, match="must be float16"):
        Weights.of({"x": np.zeros(2, dtype=np.int64)}, learner=1, version=1, updates=1)


SAMPLES = [encode(DELIVERY), encode(samples.weights()), *map(encode, samples.small_messages())]
KINDS = [Delivery, Weights, *map(type, samples.small_messages())]


@given(st.data())
@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
def test_mutated_messages_are_valid_or_refused(data):
    place = data.draw(st.integers(0, len(SAMPLES) - 1))
    mutated = bytearray(SAMPLES[place])
    for _ in range(data.draw(st.integers(1, 3))):
        position = data.draw(st.integers(0, len(mutated) - 1))
        action = data.draw(st.sampled_from(["set", "delete", "insert", "cut"]))
        if action == "set":
            mutated[position] = data.draw(st.integers(0, 255))
        elif action == "delete" and len(mutated) > 1:
            del mutated[position]
        elif action == "insert":
            mutated[position:position] = data.draw(st.binary(min_size=1, max_size=8))
        else:
            del mutated[max(1, position) :]
    try:
        message = decode(bytes(mutated), KINDS[place])
    except MessageError:
        return
    assert type(message) is KINDS[place]
    # Whatever is accepted is a message that can be sent on as it is.
    assert equal(decode(encode(message), KINDS[place]), message)


def test_only_messages_can_be_encoded():
    with pytest.raises(TypeError, match="must be one of Delivery, Ack"):
        encode({"kind": "ack"})


def test_numbers_of_other_languages_are_understood():
    # A writer whose numbers are all floating may send whole numbers as integers.
    data = msgpack.packb({"v": 3, "kind": "ack", "sequence": 1, "stored": True, "hold": 0, "error": "", "learner": 2})
    assert decode(data, Ack) == Ack(1, True, 0.0, "", 2)


def test_documents_are_plain_json():
    assert json.loads(unpack(encode(ControlReply(True, "", {"a": [1, None]})))["body"]) == {"a": [1, None]}
    assert isinstance(decode(encode(STATS), ActorStats), ActorStats)
