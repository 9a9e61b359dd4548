"""Whether a mapping is one that a policy knows from its training."""

from __future__ import annotations

import logging
from typing import Final

import numpy as np

from common.config import MappingConfig
from common.policies.policy_file import PolicyCard

log = logging.getLogger(__name__)

# Viewpoints may be this many times wider or closer, in shares of the sensor's range, than those that a policy knows.
SPACING_TOLERANCE: Final = 1.3
# With a sensor of at least this share of the shortest range in training a policy keeps up with the classical planners:
# with 15 instead of 20 m it drives as far as `tour`, with 10 m 12 % farther (docs/experiments.md).
SHORTEST_RANGE: Final = 0.7


def warn_of_other_mapping(card: PolicyCard, config: MappingConfig) -> None:
    """Log a warning that names what a policy was trained with and will not be given.

    Args:
        card: of the policy.
        config: the mapping that it will be given.
    """
    differing = _differences(card, config)
    if differing:
        log.warning("the policy of run %r was trained with a different mapping: %s", card.run, ", ".join(differing))


def of_known_scale(card: PolicyCard, config: MappingConfig) -> bool:
    """Whether cells are as large, and viewpoints as far apart for the sensor's range, as a policy knows them.

    Finer cells give it more frontier cells at each viewpoint, and another spacing a wider or more finely divided graph,
    than it ever saw. Nor does the sensor reach much less far: the same blocks then hide more. One that reaches farther
    may have viewpoints as far apart as in training.
    """
    low, high = card.ranges.get("resolution", (card.mapping.resolution, card.mapping.resolution))
    trained, _ = card.ranges.get("sensor_range", (card.mapping.sensor_range, card.mapping.sensor_range))
    far_enough = config.sensor_range >= SHORTEST_RANGE * trained
    usual = card.mapping.viewpoint_spacing
    fits = _spacing_fits(card, config) or usual <= config.viewpoint_spacing <= _spacing(card.mapping, config)
    return low <= config.resolution <= high and far_enough and fits


def _differences(card: PolicyCard, config: MappingConfig) -> list[str]:
    """Return what a policy was trained with and will not be given, in words."""
    trained, given = card.mapping.model_dump(), config.with_planning_set_of(card.mapping).model_dump()
    drawn = {name for name, (low, high) in card.ranges.items() if low <= given[name] <= high}
    # A radius changes where viewpoints are, not how the network reads them.
    scaled = {"utility_range", "min_utility", "least_utility", "beacon_range", "viewpoint_spacing", "robot_radius"}
    if card.network.features == "guided":
        # Its frontiers are counted by length.
        scaled.add("resolution")
    differing = [
        f"{name} {trained[name]} (here {given[name]})"
        for name in given
        if name not in scaled | drawn and trained[name] != given[name]
    ]
    if not _spacing_fits(card, config):
        wanted = _spacing(card.mapping, config)
        differing.append(
            f"viewpoints {wanted:g} m apart at a sensor range of {config.sensor_range:g} m "
            f"(here {config.viewpoint_spacing:g} m: set mapping.viewpoint_spacing={wanted:g})"
        )
    return differing


def _spacing_fits(card: PolicyCard, config: MappingConfig) -> bool:
    low, high = card.ranges.get("viewpoint_spacing", (np.inf, -np.inf))
    wanted = _spacing(card.mapping, config)
    return (
        low <= config.viewpoint_spacing <= high
        or wanted / SPACING_TOLERANCE <= config.viewpoint_spacing <= wanted * SPACING_TOLERANCE
    )


def _spacing(trained: MappingConfig, given: MappingConfig) -> float:
    """Return how far apart viewpoints were in training, at the given sensor's range, metres."""
    return trained.viewpoint_spacing * given.sensor_range / trained.sensor_range
