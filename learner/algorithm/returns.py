"""What an on-policy update learns from beyond imitation: the transitions whose waypoint the policy itself drew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from common.config import RunConfig
from common.network.graph_arrays import GraphArrays
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.value import value_features


@dataclass(frozen=True, slots=True, eq=False)
class Returns:
    """n of the k transitions of a batch on the device.

    Attributes:
        rows: which of the batch, int64, shape (n,).
        slot: waypoint slot that was chosen, int64, shape (n,).
        probability: of it under the policy that drew it, float32, shape (n,).
        family: of worlds, int64, shape (n,).
        now: features of o for the value function, float32, shape (n, `VALUE_FEATURES`).
        after: features of o', likewise.
        rewards: discounted sum of up to `ppo.n_step` rewards, float32, shape (n,).
        discounts: weight of V(o'), 0 where the task ended, float32, shape (n,).
    """

    rows: Tensor
    slot: Tensor
    probability: Tensor
    family: Tensor
    now: Tensor
    after: Tensor
    rewards: Tensor
    discounts: Tensor

    @classmethod
    def make(cls, batch: TransitionBatch, arrays: GraphArrays, config: RunConfig, device: torch.device) -> Returns:
        """Choose the transitions and describe their states.

        Left out are those that serve imitation alone (probability 0), and those whose o' is neither the end of the
        task nor labelled: that of a time limit, where nothing was decided, and of an actor that died.

        Raises:
            ValueError: the batch has no labels.
        """
        if batch.labels is None or batch.next_labels is None:
            raise ValueError("on-policy returns are learnt from labelled transitions: sample those, with next labels")
        known = batch.terminal | (batch.next_valid & batch.next_labelled)
        counts = (batch.probabilities > 0.0) & batch.labelled & known
        rows = np.flatnonzero(counts)
        onward = np.where(batch.terminal, np.float32(0.0), batch.discounts)

        def moved(values: np.ndarray) -> Tensor:
            return torch.from_numpy(np.ascontiguousarray(values[rows])).to(device)

        return cls(
            rows=torch.from_numpy(rows).to(device),
            slot=moved(arrays.waypoint_slots(batch.waypoints)),
            probability=moved(batch.probabilities),
            family=moved(batch.families.astype(np.int64)),
            now=moved(value_features(batch.observations, batch.labels, config)),
            after=moved(value_features(batch.next_observations, batch.next_labels, config)),
            rewards=moved(batch.rewards),
            discounts=moved(onward),
        )

    def __len__(self) -> int:
        return len(self.rows)
