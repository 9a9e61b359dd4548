"""The environment: one episode of one robot at a time, for any task; what it observes, and what it is rewarded for."""

from __future__ import annotations

from collections.abc import Sequence

from actors.expert import Expert, ExpertLabel
from actors.maps.grid_map import GridMap
from actors.protocol import check_way
from actors.rewards import StepOutcome, step_reward
from actors.robot import Robot
from actors.simulators.base import Simulator, Watch
from actors.step import Step, StepInfo
from actors.tasks import Goal
from actors.tasks.coverage import Coverage
from common.config import ImageScale, MappingConfig, RewardConfig
from common.errors import ConfigError, HDError, MapError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.messages.experience import End
from common.observations.observation import Observation
from common.planners.base import Position
from common.planners.reference import ReferenceRoute

# Decisions in a row that brought the robot nowhere before the episode is given up.
MAX_BLOCKED = 4


class Environment:
    """Runs a simulator, the robot's mapping and a task's goal; may use the true map for reward, end and metrics alone.

    Usage::

        observation = environment.reset(world, seed=0)
        while environment.end is End.NONE:
            step = environment.step(beacon, waypoint)

    A planner that chooses positions instead of nodes resets with ``on_lattice=False`` and calls ``step_to(position)``.

    Attributes:
        world: the world of this episode.
        mapping: what the robot makes of its scans.
        robot: drives, senses and maps, from `reset` on.
        end: whether and how the episode ended; it may have ended at the reset.
        reason: why it ended (see `StepInfo.reason`).
        steps: decisions taken.
        max_steps: decisions before the episode is truncated.
        total_reward: sum of the rewards.
    """

    def __init__(
        self,
        simulator: Simulator,
        mapping: MappingConfig,
        goal: Goal,
        reward: RewardConfig,
        max_steps: int,
        expert: Expert | None = None,
        reference: ReferenceRoute | None = None,
        *,
        images: ImageScale | None = None,
        replans: bool = False,
    ) -> None:
        """Put the parts together.

        Args:
            simulator: the world and the robot; the caller closes it.
            mapping: what the robot makes of its scans.
            goal: when an episode is complete.
            reward: privileged kinds need an ``expert``.
            max_steps: decisions before the episode is truncated.
            expert: privileged expert for labels and for privileged rewards.
            reference: writes the route of a classical planner into each observation, for policies that read it.
            images: draw the belief into each observation at this scale, for policies that read that.
            replans: on its way to a goal, see `step_to`, the robot stops once nothing is left to see from there; the
                simulator must take a `Watch`.

        Raises:
            ConfigError: a privileged reward without an expert.
        """
        if reward.privileged and expert is None:
            raise ConfigError(
                f"reward.kind = {reward.kind!r} needs the privileged expert: pass one, or use kind 'paper'"
            )
        self.goal = goal
        self._simulator = simulator
        self.mapping = mapping
        self._reward = reward
        self.max_steps = max_steps
        self._expert = expert
        self._reference = reference
        self._images = images
        self._replans = replans
        self.end = End.TRUNCATED
        self.reason = ""

    def reset(self, world: GridMap, seed: int, *, on_lattice: bool = True) -> Observation:
        """Begin an episode and return what the robot knows at its first viewpoint.

        A robot that starts beside the lattice first drives to its viewpoint: this counts in the distance, but it is
        no decision.

        Args:
            world: where.
            seed: of the simulator.
            on_lattice: False for planners of free positions. Then the robot stays where it starts, and the episode
                ends when the task is complete, the steps are used up or the robot is blocked for good; whether
                anything is left to do without these, or a way to go, is the planner's to say.

        Raises:
            MapError: the world does not suit the task, or no viewpoint can be reached from the start.
        """
        self.goal.reset(world)
        self.world = world
        self.coverage = Coverage(world, self.mapping.robot_radius)
        self.steps = 0
        self.total_reward = 0.0
        self._blocked_in_row = 0
        self._expert_label: ExpertLabel | None = None
        self._expert_knows = False
        self._on_lattice = on_lattice
        self.end, self.reason = End.NONE, ""
        self.robot = Robot(self._simulator, self.mapping, world, seed, self.goal.target, images=self._images)
        if self._reference is not None:
            self._reference.reset(self.goal.task.name, self.goal.target)
        complete = self._complete()
        self.robot.update()
        if self.mapper.stuck:
            raise MapError(
                f"map {world.name!r}: no viewpoint can be reached from the start {world.start}: "
                "move the start, or choose a finer mapping.viewpoint_spacing"
            )
        self._observation = self.robot.observe()
        # A robot that already has its target in reach needs no viewpoint first.
        if on_lattice and not complete:
            self.robot.go_to_viewpoint(self._complete)
            self._observe()
        self._settle()
        return self._observation

    def step(self, beacon: int, waypoint: int) -> Step:
        """Drive to a waypoint on behalf of a beacon, sense, and judge the result.

        Args:
            beacon: node number of the chosen beacon; part of the action, although only the waypoint is driven to.
            waypoint: node number of a neighbour of the robot's viewpoint, or of a target in sight.

        Raises:
            HDError: the episode has ended, or a node number is no valid choice.
        """
        self._check_choice(beacon, waypoint)
        return self._advance(self.mapper.way(self.mapper.robot, waypoint))

    def step_to(self, position: Position, via: Sequence[Position] = (), goal: Position | None = None) -> Step:
        """Drive to a position, sense, and judge the result, as `step` does.

        Args:
            position: metres, map frame; at most one longest straight edge of the viewpoint graph (sqrt(5) spacings)
                away, and the straight segment to it must be known to be free, with room for the robot.
            via: corners on the way there, metres, between which the same holds.
            goal: what the way leads to, metres; a robot that replans on its way stops once nothing is left to see from
                there.

        Raises:
            HDError: the episode has ended, or the way breaks these rules of the nominal protocol.
        """
        way = [*via, position]
        self._check_going()
        check_way(self.mapper, self.pose, way, self.mapping.viewpoint_spacing)
        return self._advance(way, self.robot.watch(goal) if self._replans and goal is not None else None)

    def _advance(self, way: list[Position], watch: Watch | None = None) -> Step:
        """Carry out one decision: drive along a way of straight legs, or until the watch stops the robot."""
        before = self.remaining() if self._reward.privileged else None
        seen = self.mapper.explored_area
        frontier = self.mapper.frontiers_removed
        to_target = self.goal.progress(self.pose)
        travelled, collided = self.distance, self.collisions
        self.robot.mapping_seconds = 0.0

        blocked = not self.robot.drive(way, self._complete, watch)
        if blocked and self._on_lattice and not self.mapper.stuck:
            self.robot.go_to_viewpoint(self._complete)
        self._blocked_in_row = self._blocked_in_row + 1 if blocked else 0
        self.steps += 1
        self._expert_label = None
        self._observe()
        self._settle()

        outcome = StepOutcome(
            distance=self.distance - travelled,
            frontier_removed=(self.mapper.frontiers_removed - frontier) * self.mapping.resolution,
            progress=to_target - self.goal.progress(self.pose),
            newly_seen=self.mapper.explored_area - seen,
            complete=self.reason == "complete",
            remaining_before=before,
            remaining_after=None if before is None else self._remaining_after(before),
        )
        reward = step_reward(self._reward, outcome)
        self.total_reward += reward
        info = StepInfo(self.reason, outcome.complete, self.coverage.explored, blocked, self.collisions - collided)
        return Step(self._observation, reward, self.end, outcome.distance, info)

    @property
    def mapper(self) -> Mapper:
        """What the robot knows."""
        return self.robot.mapper

    @property
    def pose(self) -> Pose:
        """Where the robot stands."""
        return self.robot.pose

    @property
    def positions(self) -> list[Position]:
        """(x, y) of the start and of the end of every leg, metres: the route for results files and recounts."""
        return self.robot.positions

    @property
    def corners(self) -> list[int]:
        """Those of the positions, by number, at which nothing was decided: corners of ways that are not straight."""
        return self.robot.corners

    @property
    def distance(self) -> float:
        """Travelled metres, the way to the first viewpoint included."""
        return self.robot.distance

    @property
    def collisions(self) -> int:
        """Contacts with the world."""
        return self.robot.collisions

    @property
    def mapping_seconds(self) -> float:
        """Processor time that the mapper took for the scans since the last decision, seconds."""
        return self.robot.mapping_seconds

    @property
    def success(self) -> bool:
        """The task is complete."""
        return self.reason == "complete"

    def expert_label(self) -> ExpertLabel:
        """Return the privileged expert's view of the present decision, worked out at most once.

        Raises:
            ConfigError: the environment has no expert.
        """
        if self._expert is None:
            raise ConfigError("this environment has no privileged expert: pass one when it is made")
        if not self._expert_knows:
            # Preparing takes as long as dozens of decisions, so it waits until somebody asks.
            self._expert.reset(self.world)
            self._expert_knows = True
        if self._expert_label is None:
            self._expert_label = self._expert.label(self._observation, self.mapper.viewpoints, self.pose, self.coverage)
        return self._expert_label

    def remaining(self) -> float:
        """Return T(s): metres that the expert's route still takes, 0 when the task is complete."""
        return 0.0 if self.success else self.expert_label().remaining

    def _remaining_after(self, before: float) -> float:
        """Return T(s'). A failure leaves the goal as far as it was: the travelled distance is lost."""
        if self.end is End.TERMINAL and not self.success:
            return before
        return self.remaining()

    def _settle(self) -> None:
        """Decide whether the episode ends here, and why."""
        observation = self._observation
        self._beacons, self._waypoints = observation.beacon_nodes(), observation.waypoint_nodes()
        if self.goal.complete(self.coverage, self.pose):
            self.end, self.reason = End.TERMINAL, "complete"
        elif self._on_lattice and self.mapper.stuck:
            self.end, self.reason = End.TERMINAL, "stuck"
        elif self._blocked_in_row >= MAX_BLOCKED:
            self.end, self.reason = End.TERMINAL, "blocked"
        elif self._on_lattice and len(self._beacons) == 0:
            unreachable = observation.has_target
            self.end = End.TERMINAL
            self.reason = "target unreachable" if unreachable else "nothing useful left"
        elif self._on_lattice and len(self._waypoints) == 0:
            self.end, self.reason = End.TERMINAL, "stuck"
        elif self.steps >= self.max_steps:
            self.end, self.reason = End.TRUNCATED, "step limit"
        if self._reference is not None and self._on_lattice and self.end is not End.TERMINAL:
            self._observation = self._reference.observe(self.mapper, self.pose, image=self._images)

    def _check_going(self) -> None:
        if self.end is not End.NONE:
            raise HDError(f"the episode has ended ({self.reason or 'never begun'}): call reset(world, seed) first")

    def _check_choice(self, beacon: int, waypoint: int) -> None:
        self._check_going()
        if beacon not in self._beacons:
            raise HDError(f"beacon must be one of the nodes {self._beacons.tolist()}, got {beacon}")
        if waypoint not in self._waypoints:
            raise HDError(f"waypoint must be one of the nodes {self._waypoints.tolist()}, got {waypoint}")

    def _observe(self) -> None:
        """Note what the robot knows now; one that is stuck observes nothing new."""
        if not self.mapper.stuck:
            self._observation = self.robot.observe()

    def _complete(self) -> bool:
        """Count what the robot has seen; return whether that, or where it stands, completes the task.

        A task that is complete at a corner is complete there.
        """
        belief = self.mapper.belief
        self.coverage.update(belief.cells, belief.resolution, belief.origin)
        return self.goal.complete(self.coverage, self.pose)
