"""One task from start to end: a robot and a bridge, watched, recorded and judged by the truth."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from actors.evaluation.step_limit import ample_way
from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.geometry import Pose
from common.planners.base import Position, TaskName
from common.tasks import find_task
from deploy.config import DeployConfig
from deploy.profiles import load_deploy_config
from deploy.robot.deployment import Deployment, DeploymentError
from deploy.robot.film import PackedGrid, Shot
from deploy.robot.options import RobotOptions
from deploy.robot.simulation import centred, load_world

ENDED = frozenset({"finished", "failed", "aborted"})
START_SECONDS = 600.0
"""A fresh install compiles its kernels for some minutes before the bridge says anything."""
_SILENT_SECONDS = 20.0
_SHORTEST_LIMIT = 900.0
# Of the top speed, turns and doors included; robots reach 0.6 to 0.8.
_SLOWEST_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a trial went, by what the simulation knows.

    Attributes:
        task: exploration or navigation.
        world: name of the map.
        planner: as the bridge tells.
        state: the bridge's state at the end: finished, failed, aborted, or what it was when the time was over.
        reason: its reason.
        success: the bridge says that it is done, and the truth agrees: at most 2 % of what can be reached is unseen,
            or the target is within 1 m.
        explored: share, 0 to 1, that the bridge knows of what a disc of its `mapping.robot_radius` can get to.
        to_target: distance to the target at the end, metres; None in exploration.
        distance: travelled, metres.
        seconds: of the robot, from the first status of the running task to the end.
        collisions: contacts with walls and people.
        decision_p95: seconds.
        real_time_factor: seconds of the robot per second at the end.
    """

    task: str
    world: str
    planner: str
    state: str
    reason: str
    success: bool
    explored: float
    to_target: float | None
    distance: float
    seconds: float
    collisions: int
    decision_p95: float
    real_time_factor: float

    def to_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        return asdict(self)


class Trial:
    """Runs one task and keeps what is needed to judge it and to draw it.

    Attributes:
        world: true map, with its origin where the robot starts.
        target: of navigation, map frame, metres.
        shots: recorded moments, every ``shot_seconds`` of the robot.
    """

    def __init__(
        self,
        task: TaskName,
        *,
        options: RobotOptions,
        planner: str,
        profile: str,
        folder: Path,
        settings: Sequence[str] = (),
        shot_seconds: float = 0.5,
    ) -> None:
        """Prepare a trial; the robot's world must have a target for navigation.

        Args:
            task: name of the task.
            options: the robot: world, seed, speed, noise.
            planner: name of a planner.
            profile: topics and frames.
            folder: where logs go.
            settings: parameters of the robot and the bridge, ``section.field=value``.
            shot_seconds: time between recorded moments.
        """
        self.world: GridMap = centred(load_world(options))
        self.target: Position | None = self.world.target if find_task(task).needs_target else None
        if find_task(task).needs_target and self.target is None:
            raise DeploymentError(f"map {self.world.name!r} has no target: use a navigation map or a generator")
        self.shots: list[Shot] = []
        self._task = task
        self._shot_seconds = shot_seconds
        self._options = options
        every = [f"decision.task={task}", f"decision.planner={planner}", *settings]
        self._config = load_deploy_config(overrides=every, profile=profile)
        # What lies behind a gap that the robot does not fit through is no fault of it.
        self._coverage = Coverage(self.world, self._config.mapping.robot_radius)
        self._common = ["--profile", profile, *(part for each in every for part in ("--set", each))]
        self._folder = folder

    def run(
        self,
        limit: float,
        stop: threading.Event,
        tell: Callable[[Shot, dict[str, Any], dict[str, Any]], None] | None = None,
        beside: Callable[[DeployConfig], AbstractContextManager[object]] = nullcontext,
        preparing: Callable[[str], None] | None = None,
    ) -> Verdict:
        """Run until the bridge says that it is done, ``limit`` seconds of the robot are over, or `stop` is set.

        Args:
            limit: seconds of the robot.
            stop: ends it early.
            tell: called with every recorded moment, the truth and the bridge's status.
            beside: what runs as long as robot and bridge do, such as a page; it is given the settings of their network.
            preparing: called with each line that the bridge logs until it runs; a first start compiles for a minute.

        Raises:
            DeploymentError: a process ended or fell silent.
        """
        goal = [] if self.target is None else ["--goal", f"{self.target[0]:.3f},{self.target[1]:.3f}"]
        bridge = ["--autostart", *goal]
        robot = robot_arguments(self._options)
        with (
            Deployment(self._config, self._common, robot, bridge, self._folder) as deployment,
            beside(deployment.config),
        ):
            began = self._wait_for_start(deployment, stop, preparing)
            due = began
            while not stop.is_set():
                deployment.check()
                truth, status = deployment.truth(), deployment.status()
                if truth is None or status is None or deployment.truth_age() > _SILENT_SECONDS:
                    raise DeploymentError(f"the robot is silent:\n{deployment.log_tail('robot')}")
                ended = status["state"] in ENDED or truth["time"] - began > limit
                if truth["time"] >= due or ended:
                    due = truth["time"] + self._shot_seconds
                    shot = self._shoot(deployment, truth, status)
                    if tell is not None:
                        tell(shot, truth, status)
                if ended:
                    return self._judge(truth, status, began)
                time.sleep(0.02)
            truth, status = deployment.truth(), deployment.status()
            if truth is None or status is None:
                raise DeploymentError("stopped before the robot and the bridge were ready")
            return self._judge(truth, status, began)

    @property
    def ample_seconds(self) -> float:
        """Seconds of the robot that suffice for a world of this size."""
        way = ample_way(self.world, self._config.mapping.sensor_range)
        return max(_SHORTEST_LIMIT, way / (_SLOWEST_SHARE * self._config.driving.max_speed))

    def _wait_for_start(
        self, deployment: Deployment, stop: threading.Event, preparing: Callable[[str], None] | None
    ) -> float:
        said = ""

        def started() -> bool:
            nonlocal said
            newest = deployment.log_tail("bridge", 1)
            if preparing is not None and newest != said:
                said = newest
                preparing(newest)
            status = deployment.status()
            return stop.is_set() or (
                deployment.truth() is not None and status is not None and status["state"] != "idle"
            )

        deployment.until(started, START_SECONDS, "the robot and the bridge did not start")
        truth = deployment.truth()
        return 0.0 if truth is None else float(truth["time"])

    def _shoot(self, deployment: Deployment, truth: dict[str, Any], status: dict[str, Any]) -> Shot:
        belief = deployment.belief()
        if belief is not None:
            self._coverage.update(belief.cells, belief.resolution, belief.origin)
        words = (
            f"{status['planner']}   {truth['time']:.0f} s   {truth['distance']:.0f} m   "
            f"{self._coverage.explored:.1%} explored   {status['state']}"
        )
        pose = Pose(truth["x"], truth["y"], truth["yaw"])
        people = tuple((x, y) for x, y in truth["people"])
        packed = None if belief is None else PackedGrid.of(belief)
        shot = Shot(truth["time"], pose, packed, tuple(deployment.path()), deployment.beacon(), words, people)
        self.shots.append(shot)
        return shot

    @property
    def explored(self) -> float:
        """Share, 0 to 1, that the bridge knows of what a disc of its `mapping.robot_radius` can get to."""
        return self._coverage.explored

    def _judge(self, truth: dict[str, Any], status: dict[str, Any], began: float) -> Verdict:
        pose = Pose(truth["x"], truth["y"])
        to_target = None if self.target is None else pose.distance_to(self.target)
        reached = self._coverage.explored >= 0.98 if to_target is None else to_target <= 1.0
        return Verdict(
            task=self._task,
            world=self.world.name,
            planner=status["planner"],
            state=status["state"],
            reason=status["reason"],
            success=status["state"] == "finished" and reached,
            explored=round(self._coverage.explored, 4),
            to_target=None if to_target is None else round(to_target, 3),
            distance=round(truth["distance"], 2),
            seconds=round(truth["time"] - began, 1),
            collisions=truth["collisions"],
            decision_p95=status["decision_p95"],
            real_time_factor=truth["real_time_factor"],
        )


def robot_arguments(options: RobotOptions) -> list[str]:
    """Return the options of `hd-deploy robot` that differ from their defaults, as its command line takes them."""
    arguments = []
    for name, value in options.model_dump().items():
        if value == RobotOptions.model_fields[name].default:
            continue
        option = "--" + name.replace("_", "-")
        arguments += [option if value else f"--no-{name}"] if isinstance(value, bool) else [option, str(value)]
    return arguments
