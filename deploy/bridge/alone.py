"""One bridge for one name: the second one must not start, and two that find each other later hold their robots."""

from __future__ import annotations

import logging
import secrets
import time
from contextlib import suppress
from typing import Final

import zenoh

from common.bus.fleet import BridgeId, bridges_at
from common.bus.liveness import PresenceWatcher, Process, declare_presence
from common.errors import BusError
from common.system.closing import Closing
from common.system.logs import lasting
from deploy.network_config import RosConfig
from deploy.ros2.errors import RosError
from deploy.ros2.session import open_session

log = logging.getLogger(__name__)

# Peers find each other by gossip within this time, seconds, when all of them are awake.
_FIND: Final = 1.5
_PAUSE: Final = 0.1


def new_instance() -> str:
    """Return a name for this process that no other bridge has."""
    return f"{time.time_ns():016x}-{secrets.token_hex(4)}"


class NameProbe(Closing):
    """Looks for a living bridge of the same name, from before the planners are loaded until they are.

    Usage::

        with NameProbe(config.name, config.ros) as probe:
            load_what_takes_time()
            probe.check()
    """

    def __init__(self, name: str, ros: RosConfig) -> None:
        """Join the network that the bridge is to connect to; without a router there is nobody to look for."""
        self._name = name
        self._session: zenoh.Session | None = None
        with suppress(RosError):
            self._session = open_session(ros, wait=False)
        self._until = time.monotonic() + _FIND

    def check(self) -> None:
        """Make sure that nobody has the name.

        Raises:
            BusError: a bridge of this name is at work.
        """
        try:
            while self._session is not None:
                others = bridges_at(self._session, self._name)
                if others:
                    raise BusError(_taken(self._name, others))
                if time.monotonic() > self._until:
                    return
                time.sleep(_PAUSE)
        finally:
            self.close()

    def close(self) -> None:
        """Leave the network. Safe to call twice."""
        session, self._session = self._session, None
        if session is not None:
            session.close()


class Rivals(Closing):
    """Declares this bridge, and knows of others of its name that appear on the network afterwards."""

    def __init__(self, session: zenoh.Session, name: str, instance: str) -> None:
        """Declare the bridge.

        Raises:
            BusError: another one of its name was started at the same time, and is older.
        """
        self._name = name
        self._instance = instance
        self._token = declare_presence(session, name, "bridge", instance)
        self._watcher = PresenceWatcher(session, name, self._changed)
        older = [other for other in self._others() if other < instance]
        if older:
            self.close()
            raise BusError(_taken(name, {(name, other) for other in older}))

    @property
    def problem(self) -> str:
        """Why the robot has to stand; empty while no other bridge has the name."""
        count = len(self._others())
        if not count:
            return ""
        return (
            f"{count + 1} bridges on this network have the name {self._name!r}, so commands cannot be addressed to "
            "one: give each a unique name (--name) and restart it"
        )

    def close(self) -> None:
        """Withdraw the bridge. Safe to call twice."""
        self._watcher.close()
        self._token.undeclare()

    def _others(self) -> list[str]:
        return [instance for instance in self._watcher.names("bridge") if instance != self._instance]

    def _changed(self, process: Process, there: bool) -> None:
        role, instance = process
        if role == "bridge" and instance != self._instance:
            what = "appeared: this one holds its robot" if there else "is gone"
            level = logging.ERROR if there else logging.INFO
            extra = lasting(lambda: instance in self._others())
            log.log(level, "another bridge of the name %r %s", self._name, what, extra=extra)


def _taken(name: str, others: frozenset[BridgeId] | set[BridgeId]) -> str:
    instances = ", ".join(sorted(instance for _, instance in others))
    return (
        f"a bridge with the name {name!r} is already running on this network (instance {instances}): stop it, or "
        "give this one another name with --name or ros.namespace"
    )
