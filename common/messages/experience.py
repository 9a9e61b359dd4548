"""What actors tell the learner: chunks of experience and reports of finished episodes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from common.observations.observation import ObservationBatch

FAILURE = 2.0
"""Where distances are compared, a failed episode counts so many times its own."""

MIN_PROBABILITY = 1e-12
"""Probability below which a drawn waypoint counts as drawn by nobody: what divides by it would overflow."""


class End(IntEnum):
    """How an episode ended; only a terminal end cuts the bootstrap."""

    NONE = 0
    """It continues (or its actor died)."""
    TERMINAL = 1
    """The task was completed, or cannot be completed any more."""
    TRUNCATED = 2
    """The step limit was reached."""


@dataclass(frozen=True, slots=True, eq=False)
class ExpertLabels:
    """A privileged expert's view of k decisions.

    Attributes:
        cost: detour of each waypoint in metres (the best one costs 0), the waypoints of all decisions behind one
            another in the order of `Observation.waypoint_nodes`, float32.
        beacon: node number of the first beacon that the expert's route reaches, -1 where unknown, int32, shape (k,).
        remaining: T(s), metres that the best route still takes from each state, float32, shape (k,).
        unseen: reachable area that is not seen yet, square metres, float32, shape (k,); 0 in navigation.
        gain: what each viewpoint would show, as a share of the area of the sensor's disc, the viewpoints of all
            decisions behind one another, -1 where unknown, float32; None unless the run asks for hints
            (`cloning.auxiliary_weight`).
        truth: the true map around the robot, drawn as the images of the observations are, uint8, shape (k, 2, pixels);
            None together with `gain`.
    """

    cost: NDArray[np.float32]
    beacon: NDArray[np.int32]
    remaining: NDArray[np.float32]
    unseen: NDArray[np.float32]
    gain: NDArray[np.float32] | None = None
    truth: NDArray[np.uint8] | None = None


@dataclass(frozen=True, slots=True)
class EpisodeReport:
    """One finished episode, for metrics and for the choice of the best checkpoint.

    Attributes:
        task: name of the task.
        map_name: name of the world.
        simulator: name of the simulator, with its fidelity.
        role: ``train`` or ``evaluate``.
        driver: ``policy`` or ``expert``.
        version: policy version at the episode's start.
        steps: decisions.
        distance: travelled metres.
        success: the task was completed.
        explored: share of the reachable free area that was seen, 0 to 1.
        reward: sum of rewards.
        collisions: contacts with the world.
        duration: wall seconds.
        family: name of the family of worlds (see `FamilyConfig`).
        classical_distance: how far a classical planner drives there, metres; 0 where none was asked.
    """

    task: str
    map_name: str
    simulator: str
    role: str
    driver: str
    version: int
    steps: int
    distance: float
    success: bool
    explored: float
    reward: float
    collisions: int
    duration: float
    family: str = "worlds"
    classical_distance: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """k consecutive steps of one episode, and how it ended if it did.

    A step t is (o_t, b_t, a_t, r_t); o_{t+1} is the first observation of the episode's next chunk, so no
    observation is sent twice. When the episode ends here, ``observations`` holds one more, the last.

    Attributes:
        episode: number of the episode, counted by the actor's incarnation from 0.
        first_step: number of the first step within the episode.
        observations: k observations, k + 1 when `end` is not NONE.
        beacons: chosen beacon of each step (node number), int32, shape (k,).
        waypoints: chosen waypoint of each step (node number), int32, shape (k,).
        rewards: float32, shape (k,).
        versions: policy version that chose, int64, shape (k,).
        probabilities: π(a) = Σ_b π_b π_a(a | b) of each chosen waypoint under the policy that drew it, float32,
            shape (k,); 0 where no policy drew, as on the steps of an expert, else at least `MIN_PROBABILITY`.
        labels: the expert's labels, or None.
        end: how the episode ended.
        family: number of the family of worlds that the episode's world is of, 0 to 255.
    """

    episode: int
    first_step: int
    observations: ObservationBatch
    beacons: NDArray[np.int32]
    waypoints: NDArray[np.int32]
    rewards: NDArray[np.float32]
    versions: NDArray[np.int64]
    probabilities: NDArray[np.float32]
    labels: ExpertLabels | None
    end: End
    family: int = 0

    @property
    def steps(self) -> int:
        """Number k of steps."""
        return len(self.rewards)


@dataclass(frozen=True, slots=True, eq=False)
class Delivery:
    """One acknowledged message of an actor; stored exactly once by (actor, incarnation, sequence).

    Attributes:
        actor: name of the actor.
        incarnation: random number of the actor's process; a restarted actor has a new one.
        sequence: counted by the incarnation from 0 without gaps.
        body: what is delivered.
    """

    actor: str
    incarnation: int
    sequence: int
    body: Chunk | EpisodeReport
