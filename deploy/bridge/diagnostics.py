"""The bridge's state as diagnostic_msgs, for rqt_robot_monitor, Foxglove and aggregators."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from deploy.bridge.mission import Phase
from deploy.bridge.status import Status
from deploy.ros2.messages import Message, header, message
from deploy.safety.gate_state import GateMode

OK: Final = 0
WARN: Final = 1
ERROR: Final = 2
# All other modes of the watchdog, and its death, are errors.
_GATE_LEVELS: Final[dict[str, int]] = {
    GateMode.CLEAR: OK,
    GateMode.HELD: OK,
    GateMode.OVERRIDDEN: WARN,
    GateMode.COMMAND_STALE: WARN,
}


def diagnostics(status: Status, stamp: float, node: str, distro: str) -> Message:
    """Build a DiagnosticArray with one entry each for the task, the inputs, the planner and the watchdog.

    Args:
        status: of this moment.
        stamp: robot time, seconds.
        node: name of the bridge's node, with which the names of the entries begin.
        distro: distribution whose definitions are spoken.
    """
    entries = [
        ("task", *_task(status)),
        ("inputs", *_inputs(status)),
        ("planner", *_planner(status)),
        ("watchdog", *_watchdog(status)),
    ]
    return message(
        "diagnostic_msgs/msg/DiagnosticArray",
        distro,
        header=header(stamp),
        status=[
            message(
                "diagnostic_msgs/msg/DiagnosticStatus",
                distro,
                level=level,
                name=f"{node}: {name}",
                message=text,
                hardware_id=status.name,
                values=[
                    message("diagnostic_msgs/msg/KeyValue", distro, key=key, value=str(value))
                    for key, value in values.items()
                ],
            )
            for name, level, text, values in entries
        ],
    )


_Entry = tuple[int, str, Mapping[str, Any]]


def _task(status: Status) -> _Entry:
    level = {Phase.FAILED.value: ERROR, Phase.ABORTED.value: WARN, "holding": WARN}.get(status.state, OK)
    values = {
        "state": status.state,
        "lifecycle": status.lifecycle,
        "task": status.task,
        "explored area (m2)": round(status.explored_area, 1),
        "distance (m)": round(status.distance, 1),
        "duration (s)": round(status.duration, 1),
    }
    return level, f"{status.state}: {status.reason}", values


def _inputs(status: Status) -> _Entry:
    values: dict[str, Any] = {f"{name} age (s)": round(age, 2) for name, age in status.ages.items()}
    values |= {f"dropped: {reason}": count for reason, count in status.dropped.items()}
    if status.faults:
        return ERROR, "; ".join(status.faults.values()), values
    return OK, "sound" if status.ages else "nothing received yet", values


def _planner(status: Status) -> _Entry:
    values: dict[str, Any] = {
        "planner": status.planner,
        "last decision (s)": round(status.decision_seconds, 4),
        "95 % of decisions (s)": round(status.decision_p95, 4),
        "viewpoints": status.viewpoints,
        "banned places": status.bans,
    }
    if status.policy is not None:
        values["policy"] = f"{status.policy.run}, version {status.policy.version}"
    if status.relieved:
        return WARN, f"relieved by {status.planner}: {status.relieved}", values
    return OK, f"{status.planner} decides", values


def _watchdog(status: Status) -> _Entry:
    values = {"mode": status.gate, "emergency stop": status.emergency_stop}
    return _GATE_LEVELS.get(status.gate, ERROR), status.gate_reason or status.gate, values
