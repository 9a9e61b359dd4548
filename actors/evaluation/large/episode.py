"""One episode at a large scale: an exploration, or a tour of targets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, TypedDict

from actors.environment import Environment
from actors.evaluation.episode import Outcome, Place, Tell, run_episode, tell_nobody
from actors.evaluation.large.settings import LargeSettings
from actors.evaluation.large.simulator import NotedSimulator, TrackPoint
from actors.evaluation.large.tour import leg_world, tour_targets
from actors.evaluation.omniscient import OmniscientReference
from actors.evaluation.results import PLACES
from actors.maps.grid_map import GridMap
from actors.protocol import ON_VIEWPOINT
from actors.tasks import make_goal
from common.config import RewardConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Planner, Position, TaskName, mapping_for

Decider = Planner | OmniscientReference


class Leg(TypedDict):
    """The way to one target of a tour, as plain values.

    Attributes:
        target: (x, y) in metres, map frame.
        distance_m: travelled metres.
        time_s: simulated seconds of driving.
        steps: decisions.
        collisions: contacts with walls.
        success: the robot arrived.
        reason: why the leg ended.
    """

    target: Position
    distance_m: float
    time_s: float
    steps: int
    collisions: int
    success: bool
    reason: str


@dataclass(frozen=True, slots=True)
class LargeOutcome(Outcome):
    """How an episode went; for a tour the figures are those of all its legs together.

    Attributes:
        time: simulated seconds of driving.
        collisions: contacts with walls.
        volume: explored volume, cubic metres.
        track: (seconds, x, y, yaw) at every scan, metres and radians in the map frame.
        curve: (seconds, metres, cubic metres, explored share) at the start and after every decision.
        legs: of a tour, one for each target; see `Leg`.
    """

    time: float = 0.0
    collisions: int = 0
    volume: float = 0.0
    track: list[TrackPoint] = field(default_factory=list)
    curve: list[tuple[float, float, float, float]] = field(default_factory=list)
    legs: list[Leg] = field(default_factory=list)


class OnViewpoints:
    """A planner that is told to stand on its viewpoint when it is close to it.

    A robot with wheels stops a few centimetres beside its waypoint. From there the way to the next viewpoint may touch
    a cell that the edge between the two does not; planners on the lattice would then drive back to where they are.
    """

    def __init__(self, planner: Decider) -> None:
        """Wrap a planner."""
        self._planner = planner

    @property
    def rule_applied(self) -> int | None:
        """What the planner counts, if it does; see `Outcome.notes`."""
        return getattr(self._planner, "rule_applied", None)

    @property
    def guarded(self) -> int | None:
        """Likewise."""
        return getattr(self._planner, "guarded", None)

    @property
    def name(self) -> str:
        """Name of the planner."""
        return self._planner.name

    @property
    def tasks(self) -> frozenset[TaskName]:
        """Tasks of the planner."""
        return self._planner.tasks

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode."""
        self._planner.reset(task, target, seed)

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Decide."""
        if not mapper.stuck:
            viewpoint = mapper.position(mapper.robot)
            if pose.distance_to(viewpoint) <= ON_VIEWPOINT:
                pose = Pose(*viewpoint, pose.yaw)
        return self._planner.plan(mapper, pose)


class EpisodeRunner:
    """Runs episodes with one simulator.

    Usage::

        runner = EpisodeRunner(settings, simulator)
        outcome = runner.run(planner, world, seed=3)
    """

    def __init__(self, settings: LargeSettings, simulator: NotedSimulator) -> None:
        """Set up; the caller closes the simulator."""
        self._settings = settings
        self._simulator = simulator

    def run(
        self,
        planner: Decider,
        world: GridMap,
        *,
        seed: int,
        tell: Tell = tell_nobody,
        steps: int | None = None,
        targets: int | None = None,
    ) -> LargeOutcome:
        """Run one episode.

        Args:
            planner: who decides.
            world: where.
            seed: of simulator, planner and tour.
            tell: see `run_episode`.
            steps: limit of decisions (of a leg, on a tour) in place of the settings'; decisions then take what they
                take.
            targets: number of targets in place of the settings'.

        Raises:
            HDError: the world does not suit, or the planner broke the rules of the protocol.
        """
        self._simulator.begin(world)
        if not self._settings.task.kind.needs_target:
            curve: list[tuple[float, float, float, float]] = []
            outcome, collisions = self._drive(planner, world, seed, steps, self._watch(tell, curve, 0.0))
            return self._whole(outcome, collisions, curve, [])
        return self._tour(planner, world, seed, steps, tell, targets or self._settings.targets)

    def _tour(
        self, planner: Decider, world: GridMap, seed: int, steps: int | None, tell: Tell, count: int
    ) -> LargeOutcome:
        """Visit the targets one after the other, each leg with a new belief.

        A robot that arrived goes on from where it stands; one that failed is put on the target that it missed, so that
        the other legs are those of every planner.
        """
        curve: list[tuple[float, float, float, float]] = []
        parts: list[Outcome] = []
        legs: list[Leg] = []
        here = world.start
        for target in tour_targets(world, count, seed):
            travelled = sum(leg["distance_m"] for leg in legs)
            began = self._simulator.elapsed
            watch = self._watch(tell, curve, travelled)
            outcome, collisions = self._drive(planner, leg_world(world, here, target), seed, steps, watch)
            parts.append(outcome)
            legs.append(
                Leg(
                    target=target,
                    distance_m=round(outcome.distance, PLACES),
                    time_s=round(self._simulator.elapsed - began, 3),
                    steps=outcome.steps,
                    collisions=collisions,
                    success=outcome.success,
                    reason=outcome.reason,
                )
            )
            here = self._simulator.pose.position if outcome.success else target
        missed = [number for number, leg in enumerate(legs, 1) if not leg["success"]]
        first = f"target {missed[0]}: {legs[missed[0] - 1]['reason']}" if missed else "complete"
        whole = Outcome(
            waypoints=[waypoint for part in parts for waypoint in part.waypoints],
            distance=sum(part.distance for part in parts),
            steps=sum(part.steps for part in parts),
            success=not missed,
            # Each leg has a belief of its own: how much of the world all of them saw means nothing.
            explored=0.0,
            reason=first,
            decision_ms=[time for part in parts for time in part.decision_ms],
            notes=parts[-1].notes,
        )
        return self._whole(whole, sum(leg["collisions"] for leg in legs), curve, legs)

    def _drive(
        self, planner: Decider, world: GridMap, seed: int, steps: int | None, tell: Callable[[Environment], Tell]
    ) -> tuple[Outcome, int]:
        """Run one episode of the environment; return its outcome and the number of collisions."""
        settings = self._settings
        environment = Environment(
            self._simulator,
            mapping_for(planner, settings.asked_of(planner), settings.mapping),
            make_goal(settings.task),
            RewardConfig(),
            settings.task.max_steps if steps is None else steps,
        )
        if isinstance(planner, OmniscientReference):
            planner.prepare(world, seed)
        limit = settings.time_limit if steps is None else float("inf")
        outcome = run_episode(
            environment, OnViewpoints(planner), world, seed=seed, time_limit=limit, tell=tell(environment)
        )
        return outcome, environment.collisions

    def _watch(
        self, tell: Tell, curve: list[tuple[float, float, float, float]], travelled: float
    ) -> Callable[[Environment], Tell]:
        """Return what notes the curve and passes events on, the distance counted from the begin of the tour."""

        def of(environment: Environment) -> Tell:
            def told(event: str, place: Place | None) -> None:
                if place is not None:
                    simulator = self._simulator
                    volume = 0.0 if simulator.voxels is None else simulator.voxels.volume
                    place = place._replace(distance=place.distance + travelled)
                    explored = environment.coverage.explored
                    curve.append((round(simulator.elapsed, 3), round(place.distance, 3), volume, round(explored, 5)))
                tell(event, place)

            return told

        return of

    def _whole(
        self, outcome: Outcome, collisions: int, curve: list[tuple[float, float, float, float]], legs: list[Leg]
    ) -> LargeOutcome:
        simulator = self._simulator
        values: dict[str, Any] = {each.name: getattr(outcome, each.name) for each in fields(Outcome)}
        return LargeOutcome(
            **values,
            time=round(simulator.elapsed, 3),
            collisions=collisions,
            volume=0.0 if simulator.voxels is None else simulator.voxels.volume,
            track=simulator.track,
            curve=curve,
            legs=legs,
        )
