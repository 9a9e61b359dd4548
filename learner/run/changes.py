"""What a change of its configuration means for a run that is resumed."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, Final

from common.config import RunConfig
from common.errors import ConfigError, WeightsError
from common.network.parameters import check_successor

logger = logging.getLogger(__name__)

_ELSEWHERE: Final = (
    "leave that out to resume the run, or begin another one from its policy (`hd-learner export --run {name}`, "
    "`hd-learner start --run NEW --set learner.initial_policy=FILE`)"
)
# What stored steps depend on: the numbers of families, the rewards, and whether they are steps of this task at all.
_OF_EXPERIENCE: Final[dict[str, Callable[[RunConfig], Any]]] = {
    "the task": lambda config: config.task_name,
    "reward": lambda config: config.reward,
    "families": lambda config: [family.name for family in config.mix],
}


def check_change(before: RunConfig, after: RunConfig) -> None:
    """Look at the configuration with which a run is to be resumed; the log warns of what old steps do not fit.

    Args:
        before: what the run has learnt and stored its experience with.
        after: what it is to continue with.

    Raises:
        ConfigError: its weights or its stored experience cannot be used with that.
    """
    elsewhere = _ELSEWHERE.format(name=before.name)
    if before.algorithm != after.algorithm:
        raise ConfigError(
            f"run {before.name!r} learns with algorithm={before.algorithm} and cannot change to {after.algorithm}: "
            f"{elsewhere}"
        )
    if before.hinted != after.hinted:
        raise ConfigError(
            f"run {before.name!r} stores labels with{'' if before.hinted else 'out'} hints "
            f"(cloning.auxiliary_weight={before.cloning.auxiliary_weight}) and cannot change to "
            f"{after.cloning.auxiliary_weight}: {elsewhere}"
        )
    try:
        check_successor(before.network, after.network)
    except WeightsError as error:
        raise ConfigError(f"run {before.name!r} cannot change its network: {error}; {elsewhere}") from None
    changed = [name for name, of in _OF_EXPERIENCE.items() if of(before) != of(after)]
    if changed and not _only_appended(before, after, changed) and after.checkpoints.replay:
        logger.warning(
            "%s changed: the replay buffer keeps the steps from before, with their rewards and numbers of families, "
            "until new ones replace them; --set checkpoints.replay=false begins with an empty one",
            " and ".join(changed),
        )


def _only_appended(before: RunConfig, after: RunConfig, changed: list[str]) -> bool:
    """Whether nothing changed but that families were added behind the others, whose numbers stay."""
    old, new = (_OF_EXPERIENCE["families"](config) for config in (before, after))
    return changed == ["families"] and new[: len(old)] == old
