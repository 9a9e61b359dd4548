"""What one update learns from: sampled transitions in columns, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.messages.experience import ExpertLabels
from common.network.graph_batch import GraphBatch
from common.observations.index import waypoint_counts
from common.observations.observation import ObservationBatch


@dataclass(frozen=True, slots=True, eq=False)
class Graphs:
    """What the networks read of a batch, on the learner's device.

    Attributes:
        now: all o.
        after: the o' that are bootstrapped; None without any.
    """

    now: GraphBatch
    after: GraphBatch | None


@dataclass(frozen=True, slots=True, eq=False)
class TransitionBatch:
    """k transitions (o, b, a, r, o') drawn from the replay buffer; beacons and waypoints are node numbers.

    With n-step returns, r is the discounted sum of up to n rewards and o' is what was seen after the last of them.

    Attributes:
        observations: o, k observations.
        next_observations: o', k observations; where `next_valid` is False any filler, such as o itself.
        beacons: chosen beacon, a node of o, int32, shape (k,).
        waypoints: chosen waypoint, a node of o, int32, shape (k,).
        rewards: float32, shape (k,).
        discounts: γ^m for the m steps that `rewards` sums, float32, shape (k,): the weight of what comes after o'.
        terminal: o' is the end of the task, so nothing comes after it, bool, shape (k,). A time limit is no
            terminal end: its o' is bootstrapped.
        next_valid: o' is known, bool, shape (k,). Where it is not (the actor died), the transition still serves
            imitation, and the critics leave it out.
        probabilities: of the waypoints under the policy that drew them (`Chunk.probabilities`), float32, shape (k,); 0
            where the transition serves imitation alone: no policy drew, or it was drawn from the buffer for that.
        families: number of the family of worlds of each, uint8, shape (k,).
        labelled: an expert labelled o, bool, shape (k,); all False without labels.
        labels: the expert's labels of *all* k observations: costs of all waypoints, behind one another in the order
            of `Observation.waypoint_nodes`, beacons, remaining metres, unseen area; where not labelled the beacon is
            -1 and all else 0. None when no observation is labelled.
        next_labelled: an expert labelled o', bool, shape (k,).
        next_labels: the expert's labels of the o', as in `labels`; None where they were not asked for.
        arrivals: arrival number of each o in the replay buffer, int64, shape (k,); None for a batch from elsewhere.
        graphs: made beforehand, when the symmetries have been applied too (`Prepare`); None otherwise.
    """

    observations: ObservationBatch
    next_observations: ObservationBatch
    beacons: NDArray[np.int32]
    waypoints: NDArray[np.int32]
    rewards: NDArray[np.float32]
    discounts: NDArray[np.float32]
    terminal: NDArray[np.bool_]
    next_valid: NDArray[np.bool_]
    probabilities: NDArray[np.float32]
    families: NDArray[np.uint8]
    labelled: NDArray[np.bool_]
    labels: ExpertLabels | None
    next_labelled: NDArray[np.bool_]
    next_labels: ExpertLabels | None = None
    arrivals: NDArray[np.int64] | None = None
    graphs: Graphs | None = None

    def __len__(self) -> int:
        return len(self.rewards)

    def select(self, chosen: NDArray[np.bool_]) -> TransitionBatch:
        """Return a batch of the transitions where ``chosen``, bool, shape (k,), is True, in their order."""
        return TransitionBatch(
            observations=self.observations.select(chosen),
            next_observations=self.next_observations.select(chosen),
            beacons=self.beacons[chosen],
            waypoints=self.waypoints[chosen],
            rewards=self.rewards[chosen],
            discounts=self.discounts[chosen],
            terminal=self.terminal[chosen],
            next_valid=self.next_valid[chosen],
            probabilities=self.probabilities[chosen],
            families=self.families[chosen],
            labelled=self.labelled[chosen],
            labels=_selected(self.labels, self.observations, chosen),
            next_labelled=self.next_labelled[chosen],
            next_labels=_selected(self.next_labels, self.next_observations, chosen),
            arrivals=None if self.arrivals is None else self.arrivals[chosen],
        )


def _selected(
    labels: ExpertLabels | None, observations: ObservationBatch, chosen: NDArray[np.bool_]
) -> ExpertLabels | None:
    if labels is None:
        return None
    return ExpertLabels(
        cost=labels.cost[np.repeat(chosen, waypoint_counts(observations))],
        gain=None if labels.gain is None else labels.gain[np.repeat(chosen, observations.count)],
        truth=None if labels.truth is None else labels.truth[chosen],
        beacon=labels.beacon[chosen],
        remaining=labels.remaining[chosen],
        unseen=labels.unseen[chosen],
    )
