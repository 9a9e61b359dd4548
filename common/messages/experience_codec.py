"""Deliveries as fields and back, with every check that an untrusted delivery must pass."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.messages.experience import MIN_PROBABILITY, Chunk, Delivery, End, EpisodeReport, ExpertLabels
from common.messages.fields import MAX_INCARNATION, MAX_SAFE_INTEGER, Fields
from common.messages.validation import check_choices, check_observations, first_outside
from common.observations.observation import IMAGE_SIDE, IMAGES, ObservationBatch

MAX_STEPS = 256
MAX_EPISODE_STEPS = 1_000_000
MAX_FAMILY = 255
# Far beyond every world and every setting, and so small that no sum or square of an update overflows float32.
MAX_REWARD = 1e6
MAX_METRES = 1e6
MAX_UNSEEN = 1e9
# Of the sensor's disc; cells that it touches count whole.
MAX_GAIN = 10.0
# The sums over an episode of the longest kind.
MAX_DISTANCE = 1e7
MAX_EPISODE_REWARD = 1e9
MAX_COLLISIONS = 10**9
MAX_DURATION = 1e7
# What divides: a ratio to less than this means nothing, and may overflow.
MIN_CLASSICAL_DISTANCE = 1e-3
_COLUMNS = tuple(ObservationBatch.__dataclass_fields__)
# Columns that only some networks ask for: they are left out where there are none.
_OPTIONAL = frozenset({"image"})
_LABELS = tuple(ExpertLabels.__dataclass_fields__)


def delivery_fields(delivery: Delivery) -> dict[str, Any]:
    """Return the fields of a delivery."""
    body = delivery.body
    return {
        "actor": delivery.actor,
        "incarnation": delivery.incarnation,
        "sequence": delivery.sequence,
        "body": _chunk_fields(body) if isinstance(body, Chunk) else _report_fields(body),
    }


def read_delivery(fields: Fields) -> Delivery:
    """Read and check a delivery."""
    actor = fields.identifier("actor")
    incarnation = fields.integer("incarnation", 0, MAX_INCARNATION)
    sequence = fields.integer("sequence")
    inner = fields.fields("body")
    kind = inner.word("kind", "chunk", "report")
    body = _read_chunk(inner) if kind == "chunk" else _read_report(inner)
    inner.finish()
    return Delivery(actor, incarnation, sequence, body)


def _chunk_fields(chunk: Chunk) -> dict[str, Any]:
    labels = chunk.labels
    return {
        "kind": "chunk",
        "episode": int(chunk.episode),
        "first_step": int(chunk.first_step),
        "family": int(chunk.family),
        "end": int(chunk.end),
        "observations": _observation_fields(chunk.observations),
        "beacons": chunk.beacons,
        "waypoints": chunk.waypoints,
        "rewards": chunk.rewards,
        "versions": chunk.versions,
        "probabilities": chunk.probabilities,
        "labels": None if labels is None else _label_fields(labels),
    }


def _label_fields(labels: ExpertLabels) -> dict[str, Any]:
    columns = {name: getattr(labels, name) for name in _LABELS}
    return {name: column for name, column in columns.items() if column is not None}


def _observation_fields(batch: ObservationBatch) -> dict[str, Any]:
    columns = {name: getattr(batch, name) for name in _COLUMNS}
    return {name: column for name, column in columns.items() if column is not None or name not in _OPTIONAL}


def _read_chunk(fields: Fields) -> Chunk:
    episode = fields.integer("episode")
    first_step = fields.integer("first_step", 0, MAX_EPISODE_STEPS)
    family = fields.integer("family", 0, MAX_FAMILY)
    end = End(fields.integer("end", 0, len(End) - 1))
    rewards = fields.array("rewards", np.float32, (None,))
    k = len(rewards)
    if not 1 <= k <= MAX_STEPS:
        fields.fail("rewards", f"must have 1 to {MAX_STEPS} steps, got {k}")
    _check_range(fields, "rewards", rewards, MAX_REWARD, -MAX_REWARD)
    beacons = fields.array("beacons", np.int32, (k,))
    waypoints = fields.array("waypoints", np.int32, (k,))
    versions = fields.array("versions", np.int64, (k,))
    if first_outside(versions, -1, MAX_SAFE_INTEGER) >= 0:
        fields.fail(
            "versions", f"must be from -1 to {MAX_SAFE_INTEGER}, got {int(versions.min())} to {int(versions.max())}"
        )
    probabilities = fields.array("probabilities", np.float32, (k,))
    _check_range(fields, "probabilities", probabilities, 1.0)
    if first_outside(probabilities[probabilities != 0.0], MIN_PROBABILITY, 1.0) >= 0:
        fields.fail("probabilities", f"must be 0 where no policy drew, and at least {MIN_PROBABILITY:g} elsewhere")
    columns = fields.fields("observations")
    observations = _read_observations(columns, k + (end is not End.NONE))
    inner = fields.optional_fields("labels")
    labels = None if inner is None else _read_labels(inner, k, int(observations.count[:k].sum()))
    expert = None if labels is None else labels.beacon
    choices = check_choices(observations, beacons, waypoints, expert, fields.path)
    if labels is not None and len(labels.cost) != choices:
        fields.fail("labels.cost", f"must have one cost per waypoint choice, {choices}, got {len(labels.cost)}")
    return Chunk(
        episode, first_step, observations, beacons, waypoints, rewards, versions, probabilities, labels, end, family
    )


def _read_observations(fields: Fields, k: int) -> ObservationBatch:
    utility = fields.array("utility", np.uint16, (None,))
    bent = fields.array("bent", np.uint32, (None,))
    n = len(utility)
    batch = ObservationBatch(
        count=fields.array("count", np.int32, (k,)),
        offsets=fields.array("offsets", np.int16, (n, 2)),
        utility=utility,
        visited=fields.array("visited", np.bool_, (n,)),
        beacon=fields.array("beacon", np.bool_, (n,)),
        degree=fields.array("degree", np.uint8, (n,)),
        edge_count=fields.array("edge_count", np.int32, (k,)),
        neighbours=fields.array("neighbours", np.uint16, (None,)),
        bent_count=fields.array("bent_count", np.int32, (k,)),
        bent=bent,
        bent_length=fields.array("bent_length", np.float32, (len(bent),)),
        robot=fields.array("robot", np.int32, (k,)),
        has_target=fields.array("has_target", np.bool_, (k,)),
        target_known=fields.array("target_known", np.bool_, (k,)),
        target_offset=fields.array("target_offset", np.float32, (k, 2)),
        link_count=fields.array("link_count", np.int32, (k,)),
        target_links=fields.array("target_links", np.uint16, (None,)),
        cell=fields.array("cell", np.float32, (k,)),
        reach=fields.array("reach", np.float32, (k,)),
        route_count=fields.array("route_count", np.int32, (k,)),
        route=fields.array("route", np.uint16, (None,)),
        image=fields.array("image", np.uint8, (k, len(IMAGES), IMAGE_SIDE**2)) if fields.has("image") else None,
    )
    fields.finish()
    check_observations(batch, fields.path)
    return batch


def _read_labels(fields: Fields, k: int, viewpoints: int) -> ExpertLabels:
    hints = fields.has("gain") or fields.has("truth")
    labels = ExpertLabels(
        cost=fields.array("cost", np.float32, (None,)),
        beacon=fields.array("beacon", np.int32, (k,)),
        remaining=fields.array("remaining", np.float32, (k,)),
        unseen=fields.array("unseen", np.float32, (k,)),
        gain=fields.array("gain", np.float32, (viewpoints,)) if hints else None,
        truth=fields.array("truth", np.uint8, (k, len(IMAGES), IMAGE_SIDE**2)) if hints else None,
    )
    if labels.gain is not None:
        _check_range(fields, "gain", labels.gain, MAX_GAIN, -1.0)
    _check_range(fields, "cost", labels.cost, MAX_METRES)
    _check_range(fields, "remaining", labels.remaining, MAX_METRES)
    _check_range(fields, "unseen", labels.unseen, MAX_UNSEEN)
    fields.finish()
    return labels


def _check_range(fields: Fields, name: str, values: NDArray[np.float32], largest: float, smallest: float = 0.0) -> None:
    """Raise MessageError unless all numbers are from ``smallest`` to ``largest``; NaN is not."""
    place = first_outside(values, smallest, largest)
    if place >= 0:
        fields.fail(name, f"must be from {smallest:g} to {largest:g}, got {float(values[place]):g} at place {place}")


def _report_fields(report: EpisodeReport) -> dict[str, Any]:
    return {
        "kind": "report",
        "task": report.task,
        "map_name": report.map_name,
        "simulator": report.simulator,
        "role": report.role,
        "driver": report.driver,
        "version": int(report.version),
        "steps": int(report.steps),
        "distance": float(report.distance),
        "success": bool(report.success),
        "explored": float(report.explored),
        "reward": float(report.reward),
        "collisions": int(report.collisions),
        "duration": float(report.duration),
        "family": report.family,
        "classical_distance": float(report.classical_distance),
    }


def _read_report(fields: Fields) -> EpisodeReport:
    report = EpisodeReport(
        task=fields.identifier("task"),
        map_name=fields.text("map_name"),
        simulator=fields.text("simulator", 64),
        role=fields.word("role", "train", "evaluate"),
        driver=fields.text("driver", 64),
        version=fields.integer("version", -1),
        steps=fields.integer("steps", 0, MAX_EPISODE_STEPS),
        distance=fields.number("distance", 0.0, MAX_DISTANCE),
        success=fields.flag("success"),
        explored=fields.number("explored", 0.0, 1.0),
        reward=fields.number("reward", -MAX_EPISODE_REWARD, MAX_EPISODE_REWARD),
        collisions=fields.integer("collisions", 0, MAX_COLLISIONS),
        duration=fields.number("duration", 0.0, MAX_DURATION),
        family=fields.identifier("family"),
        classical_distance=fields.number("classical_distance", 0.0, MAX_DISTANCE),
    )
    if 0.0 < report.classical_distance < MIN_CLASSICAL_DISTANCE:
        fields.fail("classical_distance", f"must be 0 where none was asked, else at least {MIN_CLASSICAL_DISTANCE:g}")
    return report
