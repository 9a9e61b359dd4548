"""The key space: one run is one prefix, and every name in it is checked."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal, get_args

from common.errors import BusError
from common.ids import check_id
from common.messages.replies import ALL_VERBS

Role = Literal["learner", "actor", "robot", "bridge", "evaluator"]
ROLES: tuple[Role, ...] = get_args(Role)

ALL_SPECS = "hd/*/spec"
"""Selects the specifications of all runs on the bus."""
ALL_BRIDGES = "hd/*/live/bridge/*"
"""Selects the presence of all processes that drive robots."""


@dataclass(frozen=True, slots=True)
class Keys:
    """The keys of one run.

    Attributes:
        run: name of the run.
    """

    run: str

    def __post_init__(self) -> None:
        _checked(self.run, "the name of a run")

    @property
    def spec(self) -> str:
        """The run's specification; the learner answers."""
        return f"hd/{self.run}/spec"

    def experience(self, actor: str) -> str:
        """Where one actor delivers; the learner answers."""
        return f"hd/{self.run}/experience/{_checked(actor, 'the name of an actor')}"

    @property
    def all_experience(self) -> str:
        """Deliveries of all actors."""
        return f"hd/{self.run}/experience/*"

    @property
    def weights_notice(self) -> str:
        """Announcements of policy versions."""
        return f"hd/{self.run}/weights/notice"

    @property
    def weights(self) -> str:
        """The newest policy version; the learner answers."""
        return f"hd/{self.run}/weights/latest"

    def live(self, role: Role, name: str) -> str:
        """Presence of one process."""
        return f"hd/{self.run}/live/{_role(role)}/{_checked(name, f'the name of a process ({role})')}"

    @property
    def all_live(self) -> str:
        """Presence of all processes."""
        return f"hd/{self.run}/live/*/*"

    def stats(self, role: Role, name: str) -> str:
        """Statistics of one process."""
        return f"hd/{self.run}/stats/{_role(role)}/{_checked(name, f'the name of a process ({role})')}"

    @property
    def all_stats(self) -> str:
        """Statistics of all processes."""
        return f"hd/{self.run}/stats/*/*"

    def view(self, role: str, name: str) -> str:
        """What an actor's episode looks like now, for whoever looks."""
        return f"hd/{self.run}/view/{_role(role)}/{_checked(name, f'the name of a process ({role})')}"

    def outcome(self, role: str, name: str) -> str:
        """What an evaluator's episodes looked like when they ended."""
        return f"hd/{self.run}/outcome/{_role(role)}/{_checked(name, f'the name of a process ({role})')}"

    @property
    def all_outcomes(self) -> str:
        """Ends of all episodes of evaluation."""
        return f"hd/{self.run}/outcome/evaluator/*"

    def control(self, verb: str) -> str:
        """Commands to the learner, or to the robot of this name."""
        if verb not in ALL_VERBS:
            raise BusError(f"a command must be one of {', '.join(ALL_VERBS)}, got {verb!r}")
        return f"hd/{self.run}/control/{verb}"

    @property
    def all_control(self) -> str:
        """Commands of all kinds."""
        return f"hd/{self.run}/control/*"


def last_part(key: str) -> str:
    """Return the last part of a key: the actor of a delivery, the verb of a command."""
    return key.rsplit("/", 1)[-1]


def run_of(key: str) -> str:
    """Return the name of the run, or of the robot, that a key belongs to; raise BusError when it is none."""
    return _checked(key.split("/", 2)[1], "the name of a run")


def process_of(key: str) -> tuple[str, str]:
    """Return (role, name) of a key of presence or statistics.

    Raises:
        BusError: the role or the name is none: anybody may declare such a key where nobody checks certificates.
    """
    _, role, name = key.rsplit("/", 2)
    return _role(role), _checked(name, f"the name of a process ({role})")


def host_of(actor: str, certified: Collection[str] = ()) -> str:
    """Return the host of an actor: the certificate that covers its name, else its name without the number behind it.

    The certificate ``desk`` covers ``desk`` and ``desk-...``.
    """
    for name in certified:
        if actor == name or actor.startswith(f"{name}-"):
            return name
    return re.sub(r"(-eval)?-[0-9]+$", "", actor)


def _checked(value: str, what: str) -> str:
    try:
        return check_id(value, what)
    except ValueError as error:
        raise BusError(str(error)) from None


def _role(role: str) -> str:
    if role not in ROLES:
        raise BusError(f"a role must be one of {', '.join(ROLES)}, got {role!r}")
    return role
