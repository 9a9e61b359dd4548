"""One episode at a large scale: an exploration, or a tour of targets."""

from __future__ import annotations

from dataclasses import replace

from actors.evaluation.episode import Decider, Tell, tell_nobody
from actors.evaluation.episode_runner import EpisodeRunner
from actors.evaluation.large.simulator import NotedSimulator
from actors.evaluation.large.tour import leg_world, tour_targets
from actors.evaluation.outcome import CurvePoint, Leg, Outcome, Place
from actors.evaluation.results import PLACES
from actors.evaluation.settings import EvaluationSettings
from actors.maps.grid_map import GridMap


class LargeEpisodeRunner(EpisodeRunner):
    """Runs explorations and tours under physics, and notes what they need for a recount; see `EpisodeRunner`."""

    def __init__(self, settings: EvaluationSettings) -> None:
        """Make the simulator; `close` closes it."""
        self._noted = NotedSimulator(settings.simulator, settings.mapping.sensor_range)
        super().__init__(settings, self._noted)

    def run(
        self, planner: Decider, world: GridMap, *, seed: int, tell: Tell = tell_nobody, steps: int | None = None
    ) -> Outcome:
        """Run one exploration or one tour; to warm up, a tour with one target."""
        self._noted.begin(world)
        if not self._settings.task.kind.needs_target:
            curve: list[CurvePoint] = []
            return self._noted_in(self._watched(planner, world, seed, tell, steps, curve, 0.0), curve)
        return self._tour(planner, world, seed, tell, steps)

    def _tour(self, planner: Decider, world: GridMap, seed: int, tell: Tell, steps: int | None) -> Outcome:
        """Visit the targets one after the other, each leg with a new belief.

        A robot that arrived continues from where it stands; one that failed is put on the target that it missed, so
        that the other legs are those of every planner.
        """
        curve: list[CurvePoint] = []
        parts: list[Outcome] = []
        legs: list[Leg] = []
        here = world.start
        for target in tour_targets(world, self._settings.targets if steps is None else 1, seed):
            travelled = sum(leg["distance_m"] for leg in legs)
            began = self._noted.elapsed
            part = self._watched(planner, leg_world(world, here, target), seed, tell, steps, curve, travelled)
            parts.append(part)
            legs.append(
                Leg(
                    target=target,
                    distance_m=round(part.distance, PLACES),
                    time_s=round(self._noted.elapsed - began, 3),
                    steps=part.steps,
                    collisions=part.collisions,
                    success=part.success,
                    reason=part.reason,
                )
            )
            here = self._noted.pose.position if part.success else target
        missed = [number for number, leg in enumerate(legs, 1) if not leg["success"]]
        whole = Outcome(
            waypoints=[waypoint for part in parts for waypoint in part.waypoints],
            distance=sum(part.distance for part in parts),
            steps=sum(part.steps for part in parts),
            success=not missed,
            # Each leg has a belief of its own: how much of the world all of them saw means nothing.
            explored=0.0,
            reason=f"target {missed[0]}: {legs[missed[0] - 1]['reason']}" if missed else "complete",
            decision_ms=[time for part in parts for time in part.decision_ms],
            notes=parts[-1].notes,
            collisions=sum(part.collisions for part in parts),
            legs=legs,
        )
        return self._noted_in(whole, curve)

    def _watched(
        self,
        planner: Decider,
        world: GridMap,
        seed: int,
        tell: Tell,
        steps: int | None,
        curve: list[CurvePoint],
        travelled: float,
    ) -> Outcome:
        """Run one episode of the environment, and continue the curve, its distance counted from the tour's begin."""
        environment = self._prepare(planner, world, seed, steps)

        def told(event: str, place: Place | None) -> None:
            if place is not None:
                place = place._replace(distance=place.distance + travelled)
                explored = environment.coverage.explored
                elapsed = round(self._noted.elapsed, 3)
                curve.append((elapsed, round(place.distance, 3), self._noted.volume, round(explored, 5)))
            tell(event, place)

        return self._drive(environment, planner, world, seed, told, steps)

    def _noted_in(self, outcome: Outcome, curve: list[CurvePoint]) -> Outcome:
        """Return an outcome with what the simulator noted."""
        noted = self._noted
        return replace(outcome, time=round(noted.elapsed, 3), volume=noted.volume, track=noted.track, curve=curve)
