"""The policy that a run begins with, and that families of worlds may imitate."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from common.config import RunConfig
from common.errors import WeightsError
from common.network.factory import make_policy_network
from common.network.parameters import with_options
from common.network.state import load_arrays
from common.policies.policy_file import PolicyCard, read_weights
from common.policies.shipped import policy_path


def read_initial(policy: str) -> tuple[dict[str, NDArray[Any]], PolicyCard]:
    """Return weights and card of `learner.initial_policy`: a file, or the task of a shipped policy.

    Raises:
        CheckpointError: it cannot be read.
    """
    return read_weights(policy_path(policy))


def initial_weights(config: RunConfig) -> tuple[dict[str, NDArray[Any]], PolicyCard] | None:
    """Return the weights that a run's network begins with, and the card of where they come from; None without any.

    Raises:
        CheckpointError: the initial policy cannot be read.
        WeightsError: it does not fit the configured network; the error names the settings that it was trained with.
    """
    policy = config.learner.initial_policy
    if policy is None:
        return None
    weights, card = read_initial(policy)
    try:
        begun = with_options(weights, card.network, config.network, config.seed)
        load_arrays(make_policy_network(config.network), begun)
    except WeightsError as error:
        wanted = config.network.model_dump()
        other = [f"network.{name}={was}" for name, was in card.network.model_dump().items() if wanted[name] != was]
        was_trained = f"; that was {', '.join(other)}" if other else ""
        raise WeightsError(f"{policy} does not fit the network: {error}{was_trained}") from error
    return begun, card
