"""Services and actions that no message store has, defined by the text that ROS 2 defines them by."""

from __future__ import annotations

import re
from collections.abc import Container
from typing import Any, Final

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

SERVICES: Final = {
    "lifecycle_msgs/srv/ChangeState": "Transition transition\n---\nbool success\n",
    "lifecycle_msgs/srv/GetState": "---\nState current_state\n",
    "lifecycle_msgs/srv/GetAvailableStates": "---\nState[] available_states\n",
    "lifecycle_msgs/srv/GetAvailableTransitions": "---\nTransitionDescription[] available_transitions\n",
}
"""Request and response of each service, divided by `---` as in a .srv file."""
ACTION_SERVICES: Final = {
    "action_msgs/srv/CancelGoal": "GoalInfo goal_info\n---\nint8 return_code\nGoalInfo[] goals_canceling\n",
}
"""Services that all actions share."""
ACTIONS: Final = {
    "nav2_msgs/action/NavigateToPose": (
        "geometry_msgs/PoseStamped pose\nstring behavior_tree\n---\n"
        "uint16 error_code\nstring error_msg\n---\n"
        "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
        "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\nfloat32 distance_remaining\n"
    ),
}
"""Goal, result and feedback of each action, divided by `---` as in a .action file; as in jazzy and kilted."""
_EVENT_INFO: Final = "service_msgs/msg/ServiceEventInfo"
_GID: Final = "client_gid", (Nodetype.ARRAY, ((Nodetype.BASE, ("uint8", 0)), 16))


def add_services(store: Typestore) -> None:
    """Add the types of all services and actions to a store: requests, responses, events, and the services themselves.

    Distributions before `service_msgs` have no events, and no hashes of services.
    """
    if _EVENT_INFO in store.fielddefs:
        # `char` is an unsigned byte in the descriptions that ROS 2 hashes, and a type of its own in those of rosbags.
        constants, fields = store.fielddefs[_EVENT_INFO]
        store.fielddefs[_EVENT_INFO] = constants, [_GID if name == _GID[0] else (name, kind) for name, kind in fields]
    store.register(_service_types(store.fielddefs))


def service_name(kind: str) -> str:
    """Return how ROS 2 names a service of a type by custom: `lifecycle_msgs/srv/GetState` is `get_state`."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", kind.rsplit("/", 1)[-1]).lower()


def _service_types(known: Container[str]) -> dict[str, Any]:
    types: dict[str, Any] = {}
    for kind, text in (SERVICES | ACTION_SERVICES).items():
        request, _, response = text.partition("---\n")
        types |= _service(kind, _fields(kind, request), _fields(kind, response), known)
    for kind, text in ACTIONS.items():
        goal, result, feedback = text.split("---\n")
        for part, content in (("Goal", goal), ("Result", result), ("Feedback", feedback)):
            types[f"{kind}_{part}"] = _fields(kind, content)
        goal_id = ("goal_id", _named("unique_identifier_msgs/msg/UUID"))
        sent: Any = [], [goal_id, ("goal", _named(f"{kind}_Goal"))]
        accepted: Any = [], [("accepted", _base("bool")), ("stamp", _named("builtin_interfaces/msg/Time"))]
        ended: Any = [], [("status", _base("int8")), ("result", _named(f"{kind}_Result"))]
        types |= _service(f"{kind}_SendGoal", sent, accepted, known)
        types |= _service(f"{kind}_GetResult", ([], [goal_id]), ended, known)
        types[f"{kind}_FeedbackMessage"] = [], [goal_id, ("feedback", _named(f"{kind}_Feedback"))]
    return types


def _service(kind: str, request: Any, response: Any, known: Container[str]) -> dict[str, Any]:
    """Return the types of a service, which is hashed as if it were a message of its parts."""
    types: dict[str, Any] = {f"{kind}_Request": request, f"{kind}_Response": response}
    parts = [("request_message", _named(f"{kind}_Request")), ("response_message", _named(f"{kind}_Response"))]
    if _EVENT_INFO in known:
        types[f"{kind}_Event"] = (
            [],
            [
                ("info", _named(_EVENT_INFO)),
                ("request", _at_most_one(f"{kind}_Request")),
                ("response", _at_most_one(f"{kind}_Response")),
            ],
        )
        parts.append(("event_message", _named(f"{kind}_Event")))
    types[kind] = [], parts
    return types


def _fields(kind: str, text: str) -> Any:
    package = kind.split("/", 1)[0]
    # Parsed as a message, because names without a package are those of the package's messages.
    (fields,) = get_types_from_msg(text, f"{package}/msg/Part").values()
    return fields


def _base(name: str) -> Any:
    return Nodetype.BASE, (name, 0)


def _named(kind: str) -> Any:
    return Nodetype.NAME, kind


def _at_most_one(kind: str) -> Any:
    return Nodetype.SEQUENCE, (_named(kind), 1)
