"""Cuts episodes into chunks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from actors.driver import Choice
from actors.expert import ExpertLabel
from actors.step import Step
from common.messages.experience import Chunk, End, ExpertLabels
from common.observations.observation import Observation, ObservationBatch


class TransitionRecorder:
    """Collects the steps of one episode after another and hands them on in chunks.

    Args:
        chunk_steps: steps per chunk.
        emit: called with every chunk.
    """

    def __init__(self, chunk_steps: int, emit: Callable[[Chunk], None]) -> None:
        self._chunk_steps = chunk_steps
        self._emit = emit
        self._episode = -1
        self._first_step = 0
        self._family = 0
        self._clear()

    @property
    def episode(self) -> int:
        """Number of the present episode, counted from 0; -1 before the first."""
        return self._episode

    def begin(self, family: int = 0) -> None:
        """Begin the next episode, in a world of a family; steps of the last one are lost unless handed on (`flush`)."""
        self._family = family
        self._episode += 1
        self._first_step = 0
        self._clear()

    def add(self, observation: Observation, choice: Choice, expert_label: ExpertLabel | None, step: Step) -> None:
        """Add one decision and its result; hands on a chunk when it is full or the episode ends.

        Args:
            observation: what the decision was made from.
            choice: the decision.
            expert_label: the expert's view of it, or None; all steps of an episode have one, or none has.
            step: what came of it.
        """
        self._observations.append(observation)
        self._choices.append(choice)
        self._rewards.append(step.reward)
        if expert_label is not None:
            self._expert_labels.append(expert_label)
        if step.end is not End.NONE:
            self._observations.append(step.observation)
            self._cut(step.end)
        elif len(self._rewards) == self._chunk_steps:
            self._cut(End.NONE)

    def flush(self) -> None:
        """Hand on what is left of an episode that is broken off."""
        if self._rewards:
            self._cut(End.NONE)

    def _clear(self) -> None:
        self._observations: list[Observation] = []
        self._choices: list[Choice] = []
        self._expert_labels: list[ExpertLabel] = []
        self._rewards: list[float] = []

    def _cut(self, end: End) -> None:
        labels = None
        if len(self._expert_labels) == len(self._rewards):
            gains = [label.gain for label in self._expert_labels if label.gain is not None]
            truths = [label.truth for label in self._expert_labels if label.truth is not None]
            labels = ExpertLabels(
                cost=np.concatenate([expert_label.cost for expert_label in self._expert_labels]),
                beacon=np.array([expert_label.beacon for expert_label in self._expert_labels], dtype=np.int32),
                remaining=np.array([expert_label.remaining for expert_label in self._expert_labels], dtype=np.float32),
                unseen=np.array([expert_label.unseen for expert_label in self._expert_labels], dtype=np.float32),
                gain=np.concatenate(gains) if gains else None,
                truth=np.stack(truths) if truths else None,
            )
        chunk = Chunk(
            episode=self._episode,
            first_step=self._first_step,
            observations=ObservationBatch.stack(self._observations),
            beacons=np.array([choice.beacon for choice in self._choices], dtype=np.int32),
            waypoints=np.array([choice.waypoint for choice in self._choices], dtype=np.int32),
            rewards=np.array(self._rewards, dtype=np.float32),
            versions=np.array([choice.version for choice in self._choices], dtype=np.int64),
            probabilities=np.array([choice.probability for choice in self._choices], dtype=np.float32),
            labels=labels,
            end=end,
            family=self._family,
        )
        self._first_step += len(self._rewards)
        self._clear()
        self._emit(chunk)
