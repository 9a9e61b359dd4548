"""Whom imitation follows in each family of worlds: the privileged expert, the reference route, or an earlier policy.

The expert knows the true map, so who imitates it plans as if the rest of the map were about to be known: in worlds
where one glimpse decides over long ways that makes robots dither. There a classical planner's route is the better
beginning for reinforcement learning; and where an earlier policy is good already, that policy is.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from common.config import RunConfig
from common.network.factory import make_policy_network
from common.network.graph_arrays import GraphArrays
from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyNetwork
from common.network.state import load_arrays
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.initial_policy import read_initial
from learner.algorithm.losses import log_marginal


class Teachers:
    """What the policy shall imitate in each observation beside, or instead of, the expert's costs.

    Args:
        config: of the run.

    Raises:
        CheckpointError: the policy that a family follows cannot be read.
        WeightsError: its weights do not fit its card.
    """

    def __init__(self, config: RunConfig) -> None:
        teachers = np.array([family.teacher for family in config.mix])
        self._reference = teachers == "reference"
        self._earlier = teachers == "policy"
        self._scale, self._largest = config.cloning.cost_scale, config.cloning.max_cost
        self._route_share = config.cloning.route_share
        self._policy: PolicyNetwork | None = None
        if self._earlier.any():
            assert config.learner.initial_policy is not None, "the configuration was checked"
            weights, card = read_initial(config.learner.initial_policy)
            self._policy = make_policy_network(card.network).requires_grad_(False)
            load_arrays(self._policy, weights)

    def wanted(self, batch: TransitionBatch, arrays: GraphArrays) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return what to imitate instead of the expert.

        Args:
            batch: k transitions.
            arrays: their observations.

        Returns:
            Probability of each waypoint slot, zeros where the expert is to be followed, float32, shape (total
            waypoints,); and the observations where it is not, bool, shape (k,).
        """
        wanted = np.zeros(len(arrays.waypoint_rows), dtype=np.float32)
        follows = np.zeros(len(batch), dtype=np.bool_)
        families = np.minimum(batch.families, len(self._reference) - 1)
        if self._reference.any() and batch.labels is not None:
            self._follow_routes(batch, arrays, self._reference[families] & batch.labelled, wanted, follows)
        chosen = self._earlier[families] & batch.labelled
        if self._policy is not None and chosen.any():
            graph = GraphBatch.from_observations(batch.observations.select(chosen), self._policy.config)
            with torch.no_grad():
                probability = log_marginal(self._policy(graph), graph).exp().numpy()
            wanted[np.repeat(chosen, np.diff(arrays.waypoint_ptr))] = probability
            follows |= chosen
        return wanted, follows

    def _follow_routes(
        self,
        batch: TransitionBatch,
        arrays: GraphArrays,
        chosen: NDArray[np.bool_],
        wanted: NDArray[np.float32],
        follows: NDArray[np.bool_],
    ) -> None:
        """Write what to imitate where a route is followed; where it begins at no waypoint, the expert is."""
        observations, labels = batch.observations, batch.labels
        assert labels is not None
        starts = np.cumsum(observations.route_count) - observations.route_count
        first = np.full(len(batch), -1, dtype=np.int64)
        on_route = observations.route_count > 0
        first[on_route] = observations.route[starts[on_route]]
        owner = np.repeat(np.arange(len(batch)), np.diff(arrays.waypoint_ptr))
        is_next = (arrays.nodes[arrays.waypoint_rows] == first[owner]) & chosen[owner]
        follows[owner[is_next]] = True
        here = follows[owner] & chosen[owner]
        prior = np.exp(-np.minimum(labels.cost / self._scale, self._largest)) * here
        total = np.bincount(owner, prior, len(batch))
        share = (1.0 - self._route_share) * prior / np.maximum(total[owner], 1e-12)
        wanted[here] = (share + self._route_share * is_next)[here]
