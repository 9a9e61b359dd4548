"""The environment: one robot in one world at a time, for any task."""

from __future__ import annotations

import time
from collections.abc import Sequence

from actors.expert import Expert, ExpertLabel
from actors.maps.grid_map import GridMap
from actors.protocol import check_way
from actors.rewards import StepOutcome, step_reward
from actors.simulators.base import Leg, Simulator, Watch
from actors.step import Step, StepInfo
from actors.tasks import Goal
from actors.tasks.coverage import Coverage
from common.config import ImageScale, MappingConfig, RewardConfig
from common.errors import ConfigError, HDError, MapError
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from common.messages.experience import End
from common.observations.observation import Observation
from common.planners.base import Position
from common.planners.goals import nothing_to_see
from common.planners.reference import ReferenceRoute

# Nearer to its viewpoint than this, metres, the robot counts as standing on it.
ON_VIEWPOINT = 0.3
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
        mapper: what the robot knows.
        pose: where the robot stands.
        end: whether and how the episode ended; it may have ended at the reset.
        reason: why it ended (see `StepInfo.reason`).
        positions: (x, y) of the start and of the end of every leg, metres: the route for results files and recounts.
        corners: those of the positions, by number, at which nothing was decided: corners of ways that are not straight.
        distance: travelled metres, the way to the first viewpoint included.
        steps: decisions taken.
        max_steps: decisions before the episode is truncated.
        collisions: contacts with the world.
        total_reward: sum of the rewards.
        mapping_seconds: processor time that the mapper took for the scans since the last decision, seconds.
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
        self.corners: list[int] = []

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
        self.steps = self.collisions = 0
        self.distance = self.total_reward = self.mapping_seconds = 0.0
        self._blocked_in_row = 0
        self._expert_label: ExpertLabel | None = None
        self._expert_knows = False
        self._on_lattice = on_lattice
        self.end, self.reason = End.NONE, ""
        self.pose = self._simulator.reset(world, seed)
        self.positions = [self.pose.position]
        self.corners = []
        width, height = world.size
        self.mapper = Mapper(
            self.mapping,
            lattice_origin=world.lattice_origin,
            bounds=(*world.origin, world.origin[0] + width, world.origin[1] + height),
            target=self.goal.target,
        )
        if self._reference is not None:
            self._reference.reset(self.goal.task.name, self.goal.target)
        self._look()
        self._update()
        if self.mapper.stuck:
            raise MapError(
                f"map {world.name!r}: no viewpoint can be reached from the start {world.start}: "
                "move the start, or choose a finer mapping.viewpoint_spacing"
            )
        observation = self._observe()
        # A robot that already has its target in reach needs no viewpoint first.
        if on_lattice and not self.goal.complete(self.coverage, self.pose):
            observation = self._go_to_viewpoint(observation)
        self._observation = observation
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
        return self._advance(way, self._watch(goal))

    def _watch(self, goal: Position | None) -> Watch | None:
        """Return what takes the scans on the way, and stops the robot once nothing is left to see from its goal.

        None where the robot decides at waypoints alone, or where there was nothing to see from the goal anyway.
        """
        mapper, spacing = self.mapper, self.mapping.viewpoint_spacing
        if goal is None or not self._replans or nothing_to_see(mapper, goal, spacing):
            return None

        def watch(pose: Pose, scan: Scan) -> bool:
            began = time.process_time()
            mapper.integrate(scan, pose)
            mapper.update(pose)
            seen = nothing_to_see(mapper, goal, spacing)
            self.mapping_seconds += time.process_time() - began
            return seen

        return watch

    def _advance(self, way: list[Position], watch: Watch | None = None) -> Step:
        """Carry out one decision: drive along a way of straight legs, or until the watch stops the robot."""
        before = self.remaining() if self._reward.privileged else None
        seen = self.mapper.explored_area
        frontier = self.mapper.frontiers_removed
        to_target = self.goal.progress(self.pose)
        travelled, collided = self.distance, self.collisions
        self.mapping_seconds = 0.0

        blocked = not self._drive(way, watch)
        if blocked and self._on_lattice and not self.mapper.stuck:
            self._go_to_viewpoint(self.mapper.observe())
        self._blocked_in_row = self._blocked_in_row + 1 if blocked else 0
        self.steps += 1
        self._expert_label = None
        if not self.mapper.stuck:
            self._observation = self._observe()
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

    def _go_to_viewpoint(self, observation: Observation) -> Observation:
        """Drive to the robot's viewpoint when it stands beside it; return what is known then."""
        node = self.mapper.position(observation.robot)
        if self.pose.distance_to(node) <= ON_VIEWPOINT:
            return observation
        self._drive(self.mapper.way_home())
        return observation if self.mapper.stuck else self._observe()

    def _observe(self) -> Observation:
        return self.mapper.observe(image=self._images)

    def _drive(self, way: list[Position], watch: Watch | None = None) -> bool:
        """Drive along a way, sensing at its corners and its end; return whether the robot got there.

        Where its first leg is not known to be free from where the robot stands, it goes by way of its viewpoint. A task
        that is complete at a corner is complete there. The graph is brought up to date where the robot stops: at
        corners nothing is decided.
        """
        if not self.mapper.segment_free(self.pose.position, way[0]) and not self.mapper.stuck:
            home = self.mapper.way_home()
            if self.pose.distance_to(home[-1]) > 1e-6 and way[: len(home)] != home:
                way = [*home, *way]
        reached = True
        for place in way:
            if self.pose.distance_to(place) == 0.0 and place != way[-1]:
                continue
            leg = self._simulator.drive_to(place) if watch is None else self._simulator.drive_to(place, watch)
            reached = self._take(leg) or leg.stopped
            self._look()
            if not reached or leg.stopped or self.goal.complete(self.coverage, self.pose):
                break
            if place != way[-1]:
                self.corners.append(len(self.positions) - 1)
        self._update()
        return reached

    def _take(self, leg: Leg) -> bool:
        began = time.process_time()
        for pose, scan in leg.sensed:
            self.mapper.integrate(scan, pose)
        self.mapping_seconds += time.process_time() - began
        self.pose = leg.pose
        self.distance += leg.distance
        self.collisions += leg.collisions
        self.positions.append(leg.pose.position)
        return leg.reached

    def _update(self) -> None:
        """Bring the graph up to date."""
        began = time.process_time()
        self.mapper.update(self.pose)
        self.mapping_seconds += time.process_time() - began

    def _look(self) -> None:
        """Scan from here, and bring the belief and the coverage up to date."""
        scan = self._simulator.scan()
        began = time.process_time()
        self.mapper.integrate(scan, self.pose)
        self.mapping_seconds += time.process_time() - began
        belief = self.mapper.belief
        self.coverage.update(belief.cells, belief.resolution, belief.origin)
