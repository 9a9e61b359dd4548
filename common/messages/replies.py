"""What the learner answers and announces: acknowledgements and the specification of its run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

PROTOCOL_VERSION = 3
"""Raised with every change that an older reader would misunderstand; peers of another version are refused."""


@dataclass(frozen=True, slots=True)
class Ack:
    """The learner's answer to a delivery.

    Attributes:
        sequence: of the delivery; -1 when the message was too damaged to tell.
        stored: it is in the learner's hands, now or since an earlier try.
        hold: seconds that the actor should pause before it collects more.
        error: why the delivery was refused for good; empty when stored, or when it should be sent again.
        learner: incarnation of the learner.
    """

    sequence: int
    stored: bool
    hold: float
    error: str
    learner: int


@dataclass(frozen=True, slots=True)
class Spec:
    """All that an actor needs to know about a run.

    Attributes:
        run: name of the run.
        learner: incarnation of the learner; a restarted learner has a new one.
        config: the resolved configuration as JSON text.
    """

    run: str
    learner: int
    config: str


@dataclass(frozen=True, slots=True)
class ControlRequest:
    """A command to a learner or a robot.

    Attributes:
        verb: one of `VERBS` for a learner, of `ROBOT_VERBS` for a robot.
        arguments: JSON object; empty but for a robot's ``goal`` (``x``, ``y``, metres) and ``stop`` (``reason``).
    """

    verb: str
    arguments: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ControlReply:
    """The answer to a command.

    Attributes:
        ok: the command was carried out.
        error: why not; empty when it was.
        body: JSON object, the state of the learner or robot after the command.
    """

    ok: bool
    error: str
    body: Mapping[str, Any]


VERBS = ("status", "pause", "resume", "checkpoint", "stop")
ROBOT_VERBS = (
    "status",
    "start",
    "pause",
    "resume",
    "abort",
    "return_home",
    "reset",
    "goal",
    "explore",
    "stop",
    "release",
)
ALL_VERBS = tuple(dict.fromkeys(VERBS + ROBOT_VERBS))
