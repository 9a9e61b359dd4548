"""Compile the learner's kernels before anything waits for it.

Compiling holds Python's lock for seconds, in which no message would be acknowledged.
"""

from __future__ import annotations

import logging
import time

import numpy as np
import torch

from common.config import RunConfig
from common.messages.experience import Chunk, Delivery, End, ExpertLabels
from common.messages.schema import decode, encode
from common.observations.observation import IMAGE_SIDE, IMAGES, STEP_UNITS, Observation, ObservationBatch
from learner.algorithm.factory import make_learner
from learner.replay.buffer import ReplayBuffer
from learner.replay.draw import draw_batch

logger = logging.getLogger(__name__)

_SLOW_SECONDS = 5.0


def warm_up(config: RunConfig, device: torch.device) -> None:
    """Take a small message in and make an update of each kind from it, with networks of the run's sizes.

    The first call of a fresh installation takes a minute, a later one a second or two.
    """
    began = time.monotonic()
    logger.info("preparing the kernels; a fresh installation takes a minute for it")
    images, hints = config.network.reads_image, config.hinted
    replay = ReplayBuffer(capacity=1_000, max_bytes=30_000_000, images=images, hints=hints)
    replay.add(decode(encode(Delivery("warm-up", 0, 0, _chunk(images, hints))), Delivery))
    rng = np.random.default_rng(0)
    once = {"updates": 1, "anchor_weight": 0.1}
    small = config.model_copy(
        update={
            "network": config.network.model_copy(update={"layers": 1}),
            "cloning": config.cloning.model_copy(update=once),
            "sac": config.sac.model_copy(update={"critic_only_updates": 1}),
            "ppo": config.ppo.model_copy(update={"value_only_updates": 1}),
        }
    )
    algorithm = make_learner(small, device)
    for update in range(3):
        algorithm.update(draw_batch(replay, small, 4, rng, cloning=update == 0))
    if (seconds := time.monotonic() - began) > _SLOW_SECONDS:
        logger.info("the kernels are ready after %.0f s", seconds)


def _chunk(images: bool, hints: bool) -> Chunk:
    """Make a short episode to and fro on a lattice of 3 x 3 viewpoints, with labels."""
    observations = [_observation(robot, images) for robot in (4, 5, 4)]
    steps = len(observations) - 1
    choices = [observation.waypoint_nodes() for observation in observations[:steps]]
    cost = np.concatenate([np.arange(len(nodes), dtype=np.float32) for nodes in choices])
    return Chunk(
        episode=0,
        first_step=0,
        observations=ObservationBatch.stack(observations),
        beacons=np.zeros(steps, dtype=np.int32),
        waypoints=np.array([nodes[0] for nodes in choices], dtype=np.int32),
        rewards=np.zeros(steps, dtype=np.float32),
        versions=np.zeros(steps, dtype=np.int64),
        probabilities=np.full(steps, 0.5, dtype=np.float32),
        labels=ExpertLabels(
            cost=cost,
            beacon=np.zeros(steps, dtype=np.int32),
            remaining=np.full(steps, 8.0, dtype=np.float32),
            unseen=np.full(steps, 50.0, dtype=np.float32),
            gain=np.full(9 * steps, 0.1, dtype=np.float32) if hints else None,
            truth=np.zeros((steps, len(IMAGES), IMAGE_SIDE**2), dtype=np.uint8) if hints else None,
        ),
        end=End.TERMINAL,
    )


def _observation(robot: int, images: bool) -> Observation:
    places = np.array([(x, y) for y in range(3) for x in range(3)])
    beside = np.triu(np.abs(places[:, None] - places).sum(axis=2) < 4, 1)
    return Observation(
        offsets=((places - places[robot]) * STEP_UNITS).astype(np.int16),
        utility=np.arange(len(places), dtype=np.uint16),
        visited=np.arange(len(places)) == robot,
        beacon=np.isin(np.arange(len(places)), (0, 8)),
        degree=beside.sum(axis=1).astype(np.uint8),
        neighbours=np.nonzero(beside)[1].astype(np.uint16),
        bent=np.array([0], dtype=np.uint32),
        bent_length=np.array([1.5], dtype=np.float32),
        robot=robot,
        has_target=True,
        target_known=False,
        target_offset=np.array([4.0, 0.0], dtype=np.float32),
        target_links=np.array([0, 8], dtype=np.uint16),
        cell=0.0625,
        reach=5.0,
        route=np.array([0], dtype=np.uint16),
        image=np.zeros((len(IMAGES), IMAGE_SIDE**2), dtype=np.uint8) if images else None,
    )
