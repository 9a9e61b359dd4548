"""What of the replay buffer each kind of update learns from."""

from __future__ import annotations

import numpy as np

from common.config import RunConfig
from learner.algorithm.batch import TransitionBatch
from learner.replay.buffer import ReplayBuffer


def may_draw(replay: ReplayBuffer, config: RunConfig, *, cloning: bool) -> bool:
    """Whether the buffer holds what `draw_batch` draws."""
    if cloning:
        return replay.labelled > 0
    if config.algorithm == "ppo" or config.sac.privileged_critic:
        return replay.labelled_transitions > 0
    return len(replay) > 0


def draw_batch(
    replay: ReplayBuffer, config: RunConfig, size: int, rng: np.random.Generator, *, cloning: bool
) -> TransitionBatch:
    """Draw the batch of one update.

    Imitation takes labelled steps of the whole buffer. Soft actor-critic takes transitions of the whole buffer,
    labelled ones where its critics are told what the expert knows. Proximal policy optimisation takes the newest
    transitions, and beside them labelled steps of the whole buffer for imitation.

    Args:
        replay: the buffer.
        config: of the run.
        size: transitions to draw.
        rng: source of chance.
        cloning: the update only imitates.

    Raises:
        ValueError: the buffer holds nothing of the kind.
    """
    if cloning:
        return replay.sample_labelled(size, rng)
    if config.algorithm == "ppo":
        ppo = config.ppo
        return replay.sample(
            size,
            rng,
            steps=ppo.n_step,
            gamma=ppo.gamma,
            labelled=True,
            newest=ppo.window,
            rehearsed=int(ppo.rehearsal * size),
        )
    sac = config.sac
    return replay.sample(size, rng, steps=sac.n_step, gamma=sac.gamma, labelled=sac.privileged_critic)
