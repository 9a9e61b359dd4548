"""Recounts a results file from its waypoints alone, and says where it disagrees."""

from __future__ import annotations

from dataclasses import dataclass

from actors.evaluation.pixels import to_metres
from actors.evaluation.results import EpisodeResult, Results
from actors.evaluation.retrace import Moment, retrace
from actors.evaluation.settings import EvaluationSettings
from actors.maps.grid_map import GridMap
from actors.tasks import make_goal
from common.errors import SimulatorError
from common.mapping.viewpoints import LONGEST_EDGE
from common.tasks import find_task

# Recorded waypoints are rounded; so much may differ without being a disagreement.
METRES = 0.01
PIXELS = 0.01
RATE = 0.002


@dataclass(frozen=True, slots=True)
class Recount:
    """What one episode's waypoints tell, and where its record says something else.

    Attributes:
        map: name of the map.
        distance: metres.
        steps: number of waypoints after the start that are not corners.
        success: the task was complete at the last waypoint.
        explored: share of the reachable free area that was seen.
        problems: disagreements and broken rules, in words; empty when all agrees.
    """

    map: str
    distance: float
    steps: int
    success: bool
    explored: float
    problems: tuple[str, ...]


def recount(results: Results, episode: EpisodeResult, world: GridMap, settings: EvaluationSettings) -> Recount:
    """Drive an episode's waypoints again and compare everything that its record says.

    Args:
        results: the file that the episode stands in.
        episode: the record.
        world: the map that it names.
        settings: task and mapping; scale and sensor range are the file's.
    """
    problems: list[str] = []
    goal = make_goal(settings.task)
    goal.reset(world)
    start = to_metres(world, episode.waypoints[0])
    if abs(start[0] - world.start[0]) + abs(start[1] - world.start[1]) > PIXELS * world.resolution + METRES:
        problems.append(f"the first waypoint {episode.waypoints[0]} is not the map's start")
    longest = LONGEST_EDGE * settings.mapping.viewpoint_spacing
    mapping = settings.mapping.model_copy(update={"sensor_range": results.sensor_range_m})
    last: Moment | None = None
    complete_at = -1
    try:
        moments = retrace(
            world,
            episode.waypoints,
            mapping,
            settings.simulator,
            seed=0,
            navigation=find_task(results.task).needs_target,
        )
        for moment in moments:
            before = 0.0 if last is None else last.distance
            if moment.distance - before > longest + METRES:
                length = moment.distance - before
                problems.append(f"step {moment.number} is {length:.2f} m long, at most {longest:.2f} m are allowed")
            if not moment.clear:
                problems.append(f"step {moment.number} leads through occupied space")
            elif not moment.known:
                problems.append(f"step {moment.number} leads through space that was not known to be free")
            if complete_at < 0 and goal.complete(moment.coverage, moment.pose):
                complete_at = moment.number
            last = moment
    except SimulatorError as error:
        problems.append(str(error))
    steps = len(episode.waypoints) - 1 - len(episode.corners)
    success = complete_at >= 0
    distance = 0.0 if last is None else last.distance
    explored = 0.0 if last is None else last.coverage.explored
    problems += _compare(episode, distance, steps, success, explored)
    last_waypoint = len(episode.waypoints) - 1
    if success and complete_at < last_waypoint:
        problems.append(f"the task was complete at waypoint {complete_at} already, {last_waypoint} are recorded")
    if steps > settings.task.max_steps:
        problems.append(f"{steps} steps were made, at most {settings.task.max_steps} are allowed")
    return Recount(episode.map, distance, steps, success, explored, tuple(problems))


def _compare(episode: EpisodeResult, distance: float, steps: int, success: bool, explored: float) -> list[str]:
    """Return where a record says something else than the recount."""
    problems = []
    if abs(episode.distance_m - distance) > METRES + 1e-4 * distance:
        problems.append(f"distance_m says {episode.distance_m:.2f}, the waypoints make {distance:.2f}")
    if episode.steps != steps:
        problems.append(f"steps says {episode.steps}, there are {steps} waypoints after the start that are not corners")
    if episode.success != success:
        problems.append(
            f"success says {str(episode.success).lower()}, but at the last waypoint the task is "
            f"{'complete' if success else 'not complete'}"
        )
    if abs(episode.explored_rate - explored) > RATE:
        problems.append(f"explored_rate says {episode.explored_rate:.4f}, the scans show {explored:.4f}")
    return problems
