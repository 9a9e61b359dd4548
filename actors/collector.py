"""Runs episodes for a learner, wherever that is: on the bus (`actors.process`) or in the same process (serial mode)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.arena import Arena, Stage
from actors.driver import Driver, ExpertDriver, PolicyDriver
from actors.episode import Role, Spectator, run_episode
from actors.maps.sources import recommended
from actors.simulators.factory import make_simulator, simulator_label
from actors.transition_recorder import TransitionRecorder
from common.config import MappingConfig, RunConfig
from common.errors import ConfigError, MapError
from common.messages.experience import Chunk, EpisodeReport
from common.policies.policy import Policy

log = logging.getLogger(__name__)

# Unusable maps in a row before the source counts as broken.
MAX_BAD_MAPS = 20
# Worlds that a warning about the step limit looks at, a fraction of a second of work.
_LOOKED_AT = 4


class Collector:
    """One simulator, one policy, and the episodes that a run asks for.

    Usage::

        collector = Collector(config, seed=[config.seed, 0], deliver=sender.send)
        collector.load(weights.tensors, weights.version, weights.updates)
        while collector.collect():
            ...
        collector.close()

    Args:
        config: the run's configuration, an actor's own choices already in it.
        seed: of worlds, sampling and simulator noise; whole numbers.
        deliver: called with every chunk and with the report of every episode.
        role: `train`: sampled actions in training worlds, with chunks; `evaluate`: greedy actions in the
            validation worlds, reports only.
        gui: open PyBullet's window.
        spectator: sees every decision and every end.

    Raises:
        ConfigError: there are no worlds for that role.
        MapError: a source of worlds cannot be used.
        SimulatorError: the simulator cannot be made.
    """

    def __init__(
        self,
        config: RunConfig,
        seed: list[int],
        deliver: Callable[[Chunk | EpisodeReport], None],
        *,
        role: str = "train",
        gui: bool = False,
        spectator: Spectator = lambda *_: None,
    ) -> None:
        self.config = config
        self.policy = Policy.from_config(config.network)
        self.steps = 0
        self.episodes = 0
        self._deliver = deliver
        self._spectator = spectator
        self._rng = np.random.default_rng(seed)
        self._updates = 0
        evaluate = role == "evaluate"
        self._simulator = make_simulator(config.simulator, config.mapping.sensor_range, gui)
        self.simulator_name = simulator_label(config.simulator)
        self._role = Role(role, self.simulator_name)
        self._arenas = [
            Arena(config, task, family, number, self._simulator, evaluate=evaluate)
            for number, family in enumerate(config.mix)
            for task in config.tasks
            if family.serves(task.name) and config.sources(family, task.name, evaluate=evaluate)
        ]
        if not self._arenas:
            kind = "validation" if evaluate else "train"
            raise ConfigError(
                f"the run has no {'validation' if evaluate else 'training'} worlds for {config.task_name}: set "
                f"maps.{kind}, or `{kind}` of a family, where the learner starts"
            )
        self._steps_of = [0] * len(self._arenas)
        if not config.families:
            for arena in self._arenas:
                for spec in config.sources(config.mix[0], arena.task, evaluate=evaluate):
                    _tell_unsuited(spec, config.mapping)
        for warning in dict.fromkeys(arena.limit_warning(_LOOKED_AT) for arena in self._arenas):
            if warning:
                log.warning("%s where the learner starts", warning)
        self.worlds: list[tuple[Arena, int]] = []
        if evaluate:
            each, over = divmod(config.maps.validation_count, len(self._arenas))
            for place, arena in enumerate(self._arenas):
                self.worlds += [(arena, number) for number in arena.fixed_numbers(each + (place < over))]
        self._classical: dict[int, float] = {}
        self._name_of: dict[tuple[Arena, str], list[int]] = {}
        self._recorder = TransitionRecorder(config.actor.chunk_steps, deliver)
        self._policy_driver = PolicyDriver(self.policy, self._rng, greedy=evaluate)
        self._expert_driver = ExpertDriver()

    def load(self, tensors: Mapping[str, NDArray[Any]], version: int, updates: int) -> None:
        """Use a policy version from the next decision on.

        Args:
            tensors: weights by name.
            version: policy version.
            updates: gradient updates behind it; they tell whether the imitation stage is over.
        """
        self.policy.load(tensors, version)
        self._updates = updates

    def collect(self, keep_on: Callable[[], bool] = lambda: True) -> EpisodeReport | None:
        """Run one training episode in a random world and deliver it.

        Args:
            keep_on: asked before every decision; False breaks the episode off.

        Returns:
            The report, or None when the episode was broken off.
        """
        cloning = self.config.cloning
        imitating = self._updates < cloning.updates
        label = imitating or self.config.labelled
        driver: Driver = self._policy_driver
        if imitating and self._rng.random() < cloning.expert_episodes:
            driver = self._expert_driver
        place = self._next_arena()
        arena = self._arenas[place]
        for _ in range(MAX_BAD_MAPS):
            before = self.steps
            try:
                stage = arena.draw(self._rng)
                seed = int(self._rng.integers(2**31))
                return self._run(arena, stage, driver, seed, keep_on, self._recorder, label)
            except MapError as error:
                log.warning("skipped a map: %s", error)
            finally:
                self._steps_of[place] += self.steps - before
        raise MapError(
            f"{MAX_BAD_MAPS} maps in a row of {arena.source.name} cannot be used; the last reasons are above"
        )

    def evaluate(self, index: int, keep_on: Callable[[], bool] = lambda: True) -> EpisodeReport | None:
        """Run validation world number ``index`` greedily and deliver the report; None when broken off.

        Of worlds with one name, maps in two folders, the second one's report says NAME (2), and so on. With families of
        worlds, the report carries the distance of the classical planner, which runs there once.
        """
        arena, number = self.worlds[index]
        if self.config.families and index not in self._classical:
            self._classical[index] = arena.classical_distance(number)
        classical = self._classical.get(index, 0.0)
        stage = arena.fixed(number)
        namesakes = self._name_of.setdefault((arena, stage.world.name), [])
        if index not in namesakes:
            namesakes.append(index)
        place = 1 + namesakes.index(index)
        if place > 1:
            stage = replace(stage, world=replace(stage.world, name=f"{stage.world.name} ({place})"))
        return self._run(arena, stage, self._policy_driver, index, keep_on, None, False, classical)

    def _next_arena(self) -> int:
        """Return the arena that lacks most steps for its share, the first of several."""
        shares = [steps / arena.share for steps, arena in zip(self._steps_of, self._arenas, strict=True)]
        return int(np.argmin(shares))

    def close(self) -> None:
        """Release the simulator; safe to call twice."""
        self._simulator.close()

    def _run(
        self,
        arena: Arena,
        stage: Stage,
        driver: Driver,
        seed: int,
        keep_on: Callable[[], bool],
        recorder: TransitionRecorder | None,
        label: bool,
        classical: float = 0.0,
    ) -> EpisodeReport | None:
        def counted() -> bool:
            going = keep_on()
            self.steps += going
            return going

        report = run_episode(
            stage.environment,
            stage.world,
            driver,
            self._role,
            seed=seed,
            recorder=recorder,
            label=label,
            family=arena.number,
            keep_on=counted,
            look=partial(self._spectator, arena.family),
        )
        if report is not None:
            report = replace(report, family=arena.family, classical_distance=classical)
            self.episodes += 1
            self._deliver(report)
        return report


def _tell_unsuited(spec: str, mapping: MappingConfig) -> None:
    """Warn where a set of worlds recommends another mapping: all actors of a run have the learner's."""
    settings = recommended(spec).settings.items()
    values = {path: value for path, value in settings if path.startswith("mapping.")}
    other = [f"{path}={value}" for path, value in values.items() if getattr(mapping, path.partition(".")[2]) != value]
    if other:
        log.warning("%s suits %s, the run has other values: set them where the learner starts", spec, " ".join(other))
