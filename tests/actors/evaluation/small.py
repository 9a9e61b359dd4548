"""Small evaluations for tests: settings, results made by hand, and planners that misbehave."""

from __future__ import annotations

import os
import time

from actors.evaluation.results import DecisionTime, EpisodeResult, Results
from actors.evaluation.settings import EvaluationSettings
from common.config import MappingConfig
from common.planners.base import Plan, Status
from common.planners.exploration.greedy import GreedyPlanner

MAPS = "generator:rooms?width=320&height=240"


def settings(**values) -> EvaluationSettings:
    return EvaluationSettings(**{"maps": (MAPS,), "limit": 2, **values})


def results(planner="greedy", distances=(10.0, 20.0, 30.0), success=None, **values) -> Results:
    """Results with given distances, on maps named by number."""
    done = [True] * len(distances) if success is None else success
    episodes = [
        EpisodeResult(
            map=f"img_{number}.png",
            waypoints=[(0.0, 0.0), (4.0 * distance, 0.0)],
            distance_m=distance,
            steps=1,
            success=ok,
            explored_rate=0.9,
            decision_ms=DecisionTime(median=2.0, p95=3.0),
        )
        for number, (distance, ok) in enumerate(zip(distances, done, strict=True))
    ]
    head = {"task": "exploration", "metres_per_pixel": 0.25, "sensor_range_m": 20.0, "commit": "abc", "seed": 0}
    return Results(planner=planner, episodes=episodes, **{**head, **values})


class _Misbehaving(GreedyPlanner):
    """Explores greedily, and does something bad at its third decision; not in its first episode, the warm-up."""

    resets = 0

    def reset(self, task, target, seed):
        super().reset(task, target, seed)
        self.decisions = 0
        self.resets += 1

    def plan(self, mapper, pose):
        self.decisions += 1
        # The constructor resets too.
        bad = self.decisions == 3 and self.resets > 2
        return self.misbehave(pose) if bad else super().plan(mapper, pose)


class RaisingPlanner(_Misbehaving):
    def misbehave(self, pose):
        raise RuntimeError("a fault in the planner")


class DyingPlanner(_Misbehaving):
    def misbehave(self, pose):
        os._exit(7)


class HangingPlanner(_Misbehaving):
    def misbehave(self, pose):
        while True:
            time.sleep(0.1)


class CheatingPlanner(_Misbehaving):
    def misbehave(self, pose):
        return Plan(Status.GOING, waypoint=(pose.x + 50.0, pose.y))


class SlowPlanner(_Misbehaving):
    def misbehave(self, pose):
        began = time.process_time()
        while time.process_time() - began < 0.3:
            pass
        return Plan(Status.GOING, waypoint=pose.position)


MAPPING = MappingConfig()
