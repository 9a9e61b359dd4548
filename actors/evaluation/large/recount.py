"""Recounts episodes at a large scale from their tracks, and says where the records disagree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.evaluation.large.lidar import GridLidar
from actors.evaluation.large.results import LargeEpisode, LargeResults, settings_of
from actors.evaluation.large.tour import leg_world
from actors.evaluation.large.voxels import VoxelMap
from actors.evaluation.settings import EvaluationSettings
from actors.maps.grid_map import GridMap
from actors.simulators.beams import BeamPattern
from actors.tasks import make_goal
from actors.tasks.coverage import Coverage
from common.geometry import Pose
from common.mapping.belief import Belief
from common.tasks import find_task

# Tracks are chords at the lidar's rate and their scans are made upright; so much may differ.
DISTANCE_SHARE: Final = 0.03
VOLUME_SHARE: Final = 0.02
EXPLORED: Final = 0.003
SECONDS: Final = 0.05
METRES: Final = 0.05
# Height of the lidar above the floor, metres (the mast of the robot).
MAST: Final = 0.45
# A robot may be a little faster than it was told to be while it brakes; a step further than that is a new leg.
HASTE: Final = 1.2


@dataclass(frozen=True, slots=True)
class Seen:
    """What the lidar sees from all places of a track.

    Attributes:
        volume: explored volume, cubic metres.
        coverage: what of the true map became known.
    """

    volume: float
    coverage: Coverage


def recount(results: LargeResults, episode: LargeEpisode, world: GridMap) -> list[str]:
    """Return the disagreements between an episode's record and its track, in words; none when all agrees.

    Collisions and decision times cannot be counted from a track and are not checked.
    """
    settings = settings_of(results)
    track = np.array(episode.track)
    problems = _way(episode, track, world, settings)
    seen = _look(track, world, settings)
    if abs(seen.volume - episode.volume_m3) > VOLUME_SHARE * episode.volume_m3:
        problems.append(f"volume_m3 says {episode.volume_m3:.1f}, the scans show {seen.volume:.1f}")
    if not find_task(results.task).needs_target:
        explored = seen.coverage.explored
        if abs(explored - episode.explored_rate) > EXPLORED:
            problems.append(f"explored_rate says {episode.explored_rate:.4f}, the scans show {explored:.4f}")
        goal = make_goal(settings.task)
        goal.reset(world)
        doubtful = abs(seen.coverage.unseen_area - settings.task.unseen_area) < EXPLORED * world.free_area
        if goal.complete(seen.coverage, Pose(*track[-1, 1:3])) != episode.success and not doubtful:
            problems.append(f"success says {str(episode.success).lower()}, the scans show otherwise")
    else:
        problems += _arrivals(episode, track, world, settings)
    return problems


def _way(episode: LargeEpisode, track: NDArray[np.float64], world: GridMap, settings: EvaluationSettings) -> list[str]:
    """Check distance, time, speed, and that every place is free."""
    problems = []
    steps = np.hypot(*np.diff(track[:, 1:3], axis=0).T)
    seconds = np.diff(track[:, 0])
    within = steps <= HASTE * settings.simulator.speed * seconds + METRES
    jumps = len(steps) - int(np.count_nonzero(within))
    if jumps > sum(not leg.success for leg in episode.legs[:-1]):
        problems.append(f"the robot was faster than {settings.simulator.speed:g} m/s allow in {jumps} places")
    distance = float(steps[within].sum())
    if abs(distance - episode.distance_m) > DISTANCE_SHARE * episode.distance_m + METRES:
        problems.append(f"distance_m says {episode.distance_m:.2f}, the track makes {distance:.2f}")
    if abs(float(track[-1, 0]) - episode.time_s) > SECONDS:
        problems.append(f"time_s says {episode.time_s:.2f}, the track ends at {track[-1, 0]:.2f}")
    if np.any(seconds < 0.0):
        problems.append("the times of the track do not rise")
    blocked = [point for point in track[:, 1:3].tolist() if not world.is_free((point[0], point[1]))]
    if blocked:
        problems.append(f"{len(blocked)} places of the track are in obstacles, the first is {tuple(blocked[0])}")
    return problems


def _arrivals(
    episode: LargeEpisode, track: NDArray[np.float64], world: GridMap, settings: EvaluationSettings
) -> list[str]:
    """Check that the robot was at the targets that it is said to have reached, in their order."""
    problems = []
    goal = make_goal(settings.task)
    coverage = Coverage(world, settings.mapping.robot_radius)
    places = [Pose(x, y) for x, y in track[:, 1:3].tolist()]
    for number, leg in enumerate(episode.legs, 1):
        if not leg.success:
            continue
        goal.reset(leg_world(world, world.start, leg.target))
        arrived = next((place for place, pose in enumerate(places) if goal.complete(coverage, pose)), None)
        if arrived is None:
            problems.append(f"target {number} is recorded as reached, but the track does not reach it in order")
        else:
            places = places[arrived:]
    if episode.success != all(leg.success for leg in episode.legs):
        problems.append(f"success says {str(episode.success).lower()}, the legs say otherwise")
    return problems


def _look(track: NDArray[np.float64], world: GridMap, settings: EvaluationSettings) -> Seen:
    """Scan from every place of a track, the lidar upright."""
    simulator, mapping = settings.simulator, settings.mapping
    lidar = GridLidar(BeamPattern(simulator.rays, mapping.sensor_range), simulator.lidar_layers, simulator.wall_height)
    lidar.enter(world)
    width, height = world.size
    belief = Belief(
        mapping.resolution,
        mapping.sensor_range,
        bounds=(*world.origin, world.origin[0] + width, world.origin[1] + height),
    )
    voxels = VoxelMap(world, simulator.wall_height)
    coverage = Coverage(world, mapping.robot_radius)
    for _, x, y, yaw in track.tolist():
        pose = Pose(x, y, yaw)
        if world.is_free(pose.position):
            belief.integrate(lidar.look(pose, MAST), pose)
            voxels.add(lidar.point_cloud())
    coverage.update(belief.cells, belief.resolution, belief.origin)
    return Seen(voxels.volume, coverage)
