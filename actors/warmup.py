"""Compile all kernels of an actor once, so that several processes started later only load them.

``python -m actors.warmup [NETWORK]`` does it in a process of its own, for a network given as JSON (`NetworkConfig`).
"""

from __future__ import annotations

import os
import sys
import threading

import numpy as np

from actors.driver import ExpertDriver, PolicyDriver
from actors.environment import Environment
from actors.episode import Role, run_episode
from actors.expert import make_expert
from actors.maps.files import warm_up as warm_up_files
from actors.maps.generators import make_generator
from actors.maps.generators import warm_up as warm_up_generators
from actors.parent import follow_parent
from actors.simulators.factory import make_simulator
from actors.tasks import make_goal
from actors.transition_recorder import TransitionRecorder
from common.config import MappingConfig, NetworkConfig, RewardConfig, SimulatorConfig, TaskConfig
from common.mapping.warmup import warm_up as warm_up_mapping
from common.messages.experience import Chunk, Delivery
from common.messages.schema import encode
from common.planners.reference import ReferenceRoute
from common.policies.policy import Policy
from common.system.kernel_folders import forget_old_caches
from common.system.logs import setup_logging
from common.tasks import BOTH


def warm_up(network: NetworkConfig) -> None:
    """Compile, or load from numba's cache, whatever an actor calls: both tasks, both experts, one network.

    The first call of a fresh install takes a minute or so, a later one a few seconds.

    Args:
        network: of the run; kernels are compiled for its size of a head.
    """
    forget_old_caches()
    warm_up_mapping()
    warm_up_generators()
    warm_up_files()
    rng = np.random.default_rng(0)
    role = Role("train", "grid")
    mapping = MappingConfig()
    simulator = make_simulator(SimulatorConfig(name="grid", rays=180), mapping.sensor_range)
    world = make_generator("rooms", {"width": "320", "height": "240"}).world(0, 0.25)
    policy = Policy.from_config(network)
    recorder = TransitionRecorder(4, _encode)
    for kind in BOTH:
        task = TaskConfig(name=kind.name)
        reward = RewardConfig(kind="potential")
        reference = ReferenceRoute(mapping) if network.features == "guided" else None
        expert = make_expert(task, mapping)
        images = network.image_scale
        environment = Environment(simulator, mapping, make_goal(task), reward, 4, expert, reference, images=images)
        for driver in (PolicyDriver(policy, rng), ExpertDriver()):
            run_episode(environment, world, driver, role, seed=0, recorder=recorder, label=True)
    simulator.close()


def _encode(chunk: Chunk) -> None:
    encode(Delivery("warm-up", 0, 0, chunk))


if __name__ == "__main__":
    # What it compiles, and how far it is, is told in the log of whoever starts it.
    setup_logging(os.environ.get("HD_LOG_LEVEL", "info"))
    follow_parent(os.getppid(), threading.Event())
    warm_up(NetworkConfig.model_validate_json(sys.argv[1]) if len(sys.argv) > 1 else NetworkConfig())
