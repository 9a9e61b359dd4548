"""One episode, as the paper tells it: observe, choose a beacon and a waypoint, drive, sense, learn what came of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from actors.driver import Choice, Driver
from actors.environment import Environment
from actors.maps.grid_map import GridMap
from actors.transition_recorder import TransitionRecorder
from common.messages.experience import End, EpisodeReport
from common.system.printable import printable


@dataclass(frozen=True, slots=True)
class Role:
    """How an actor's episodes are reported.

    Attributes:
        name: `train` or `evaluate`.
        simulator: name of the simulator, with its fidelity.
    """

    name: str
    simulator: str


class Spectator(Protocol):
    """Whoever looks at episodes; what it does is no part of them."""

    def __call__(self, family: str, environment: Environment, driver: Driver, choice: Choice | None) -> None:
        """See a decision before it is carried out, or, without a choice, how an episode ended."""
        ...


def run_episode(
    environment: Environment,
    world: GridMap,
    driver: Driver,
    role: Role,
    *,
    seed: int,
    recorder: TransitionRecorder | None = None,
    label: bool = False,
    family: int = 0,
    keep_on: Callable[[], bool] = lambda: True,
    look: Callable[[Environment, Driver, Choice | None], None] = lambda *_: None,
) -> EpisodeReport | None:
    """Run one episode.

    Args:
        environment: the simulator, the mapping and the task.
        world: where.
        driver: who chooses.
        role: how the episode is reported.
        seed: of the simulator.
        recorder: takes every step; None when only the report matters.
        label: let the privileged expert judge every decision, for imitation.
        family: number of the world's family, which its chunks carry.
        keep_on: asked before every decision; False breaks the episode off.
        look: sees every decision, and the end; see `Spectator`.

    Returns:
        The report, or None when the episode was broken off.
    """
    began = time.monotonic()
    version = driver.version
    if recorder is not None:
        recorder.begin(family)
    observation = environment.reset(world, seed)
    while environment.end is End.NONE:
        if not keep_on():
            if recorder is not None:
                recorder.flush()
            return None
        expert_label = environment.expert_label() if label else None
        choice = driver.choose(observation, environment)
        look(environment, driver, choice)
        step = environment.step(choice.beacon, choice.waypoint)
        if recorder is not None:
            recorder.add(observation, choice, expert_label, step)
        observation = step.observation
    look(environment, driver, None)
    return EpisodeReport(
        task=environment.goal.task.name,
        map_name=printable(world.name)[:256],
        simulator=role.simulator,
        role=role.name,
        driver=driver.name,
        version=version,
        steps=environment.steps,
        distance=environment.distance,
        success=environment.success,
        explored=environment.coverage.explored,
        reward=environment.total_reward,
        collisions=environment.collisions,
        duration=time.monotonic() - began,
    )
