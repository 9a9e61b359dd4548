"""The names of node features: which of them each network reads, and the units of some."""

from __future__ import annotations

from typing import Literal

FeatureSet = Literal["paper", "extended", "guided", "ariadne", "ca"]
FEATURE_NAMES: dict[FeatureSet, tuple[str, ...]] = {
    "paper": (
        "x",
        "y",
        "utility",
        "visited",
        "beacon",
        "robot",
        "target",
        "target_direction_x",
        "target_direction_y",
        "target_distance",
    )
}
FEATURE_NAMES["extended"] = (
    *FEATURE_NAMES["paper"],
    "robot_graph_distance",
    "degree",
    "useful_graph_distance",
    "on_beacon_path",
    "target_graph_distance",
)

FEATURE_NAMES["guided"] = (
    *FEATURE_NAMES["extended"],
    "on_route",
    "route_distance",
    "route_next",
    "reach",
)

# The features of two publications: nothing that is not among those of the set `paper`.
FEATURE_NAMES["ariadne"] = ("x", "y", "utility", "visited")
FEATURE_NAMES["ca"] = (*FEATURE_NAMES["ariadne"], "target_direction_x", "target_direction_y", "target_distance")

DISTANCE_SCALE = 20.0
"""Lattice steps per unit of a position or distance."""
REACH_SCALE = 10.0
"""Lattice steps per unit of the sensor's range."""


def feature_count(features: FeatureSet) -> int:
    """Number F of features per node."""
    return len(FEATURE_NAMES[features])


def computed_set(features: FeatureSet) -> FeatureSet:
    """Return the set that `node_features` computes for a network of these features."""
    return "paper" if features in ("ariadne", "ca") else features


def feature_columns(features: FeatureSet) -> list[int]:
    """Return the columns, among those of `computed_set`, that a network of these features reads."""
    computed = FEATURE_NAMES[computed_set(features)]
    return [computed.index(name) for name in FEATURE_NAMES[features]]
