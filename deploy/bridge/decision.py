"""The decision loop: refresh the map, check health, plan. It knows no topics: recordings and tests run it as well."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Position, Status
from common.planners.goals import nothing_to_see
from deploy.bridge.aim import Aim
from deploy.bridge.checkup import Checkup
from deploy.bridge.completion import CompletionChecks
from deploy.bridge.decision_schedule import DecisionSchedule
from deploy.bridge.diagnosis import behind_closed_way, diagnose
from deploy.bridge.legs import begun_at, drivable
from deploy.bridge.map_source import MapSource
from deploy.bridge.mission import Mission, Orders, Phase, too_far
from deploy.bridge.outcome import Course, Outcome
from deploy.bridge.plan_supervisor import PlanSupervisor
from deploy.bridge.planner_selector import PlannerError, PlannerSelector
from deploy.bridge.standing import MotionCheck
from deploy.bridge.unseen import Unseen
from deploy.bridge.way_out import way_out
from deploy.config import DecisionConfig, SafetyConfig
from deploy.safety.health import HealthMonitor

log = logging.getLogger(__name__)


class DecisionLoop:
    """Decides where the robot goes.

    Usage::

        loop = DecisionLoop(decision, mapping, safety, robot_map, planners, Mission("exploration"), health)
        while True:
            outcome = loop.step()  # several times per decision: it plans when it is due
    """

    def __init__(
        self,
        config: DecisionConfig,
        mapping: MappingConfig,
        safety: SafetyConfig,
        robot_map: MapSource,
        planners: PlannerSelector,
        mission: Mission,
        health: HealthMonitor,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin; messages are fed to `robot_map` and `health`, commands to `mission`, by others.

        Args:
            config: when to decide, and when a place is reached.
            mapping: of the map.
            safety: where the robot may go, and how long it may get nowhere.
            robot_map: the robot's map.
            planners: the planners.
            mission: the robot's orders.
            health: watches the inputs.
            clock: seconds, monotonic; that of a recording when one is replayed.
        """
        self.planners = planners
        self._config = config
        self._mapping = mapping
        self._map = robot_map
        self._mission = mission
        self._checkup = Checkup(health, robot_map)
        self._clock = clock
        self._supervisor = PlanSupervisor(safety, mapping)
        self._motion = MotionCheck(safety.progress_time)
        self._checks = CompletionChecks(config.completion_checks)
        self._blocked = ""
        self._blocked_lock = threading.Lock()
        self._episode = 0
        self._map_resets = 0
        self._version = -1
        self._was_moving = False
        self._course: Course | None = None
        self._aim: Aim | None = None
        self._unseen: Unseen | None = None
        self._hold = ""
        self._schedule = DecisionSchedule(config.rate)

    def report_blocked(self, reason: str) -> None:
        """Tell from any thread that the way to the waypoint is blocked."""
        with self._blocked_lock:
            self._blocked = reason

    def step(self, *, in_other_hands: bool = False) -> Outcome:
        """Run one pass: refresh the map, check health, and plan when it is due.

        Args:
            in_other_hands: somebody else has the robot, or nobody drives it, which is no time without progress.
        """
        now, began = self._clock(), time.perf_counter()
        orders = self._obey(now)
        if in_other_hands:
            self._supervisor.wait(now)
            self._motion.reset()
        mapper = self._refresh(now)
        pose = self._map.pose
        self._motion.take(now, pose)
        self._checkup.check(mapper, self._course, now)
        decided = False
        if orders.moving:
            if mapper is not None:
                self._supervisor.look(mapper, now)
            broken = self._checkup.holding
            if broken is not None:
                self._stand(broken.reason)
                self._schedule.hurry(now)
            elif mapper is None or pose is None:
                self._stand(self._map.statistics.outdated or diagnose(mapper, pose, self._mapping).text)
            elif self._due(mapper, pose, now):
                decided = self._decide(mapper, pose, now)
            elif self._course is not None and self._schedule.may_ask(now):
                # The decision stands because nothing has changed; that is just what must not last.
                self._schedule.wait(now)
                self._watch(self._course, mapper, pose, None, now)
        return self._outcome(mapper, pose, now, decided, time.perf_counter() - began)

    # The stages of a pass.

    def _obey(self, now: float) -> Orders:
        """Carry out what commands have changed since the last pass."""
        orders = self._mission.orders
        if orders.map_resets != self._map_resets:
            self._map_resets = orders.map_resets
            if self._map.statistics.misplaced:
                # Home was a place of the old map.
                self._mission.forget_home()
                orders = self._mission.orders
            self._map.reset(orders.target)
        if orders.episode != self._episode:
            self._episode = orders.episode
            self._begin_episode(orders, now)
        if orders.moving and not self._was_moving:
            self._supervisor.wait(now)
            self._schedule.hurry(now)
        if not orders.moving:
            self._stand("")
        self._was_moving = orders.moving
        return orders

    def _begin_episode(self, orders: Orders, now: float) -> None:
        self._stand("")
        self._checks.reset()
        self._unseen = None
        self._schedule.restart(now)
        if orders.purpose is Phase.RETURNING and orders.home is not None:
            self._supervisor.begin(orders.home, now)
            self.planners.go_to(orders.home)
            return
        self._supervisor.begin(orders.target, now)
        self._map.set_target(orders.target)
        if orders.task is self._mission.task:
            self.planners.begin(orders.task.name, orders.target)
        elif orders.target is not None:
            # An exploration that is left for a target: the planner in charge may know no targets.
            self.planners.go_to(orders.target)

    def _refresh(self, now: float) -> Mapper | None:
        mapper = self._map.refresh()
        self._version = self._map.statistics.integrated
        self._checkup.note_map(self._version, now)
        return mapper

    def _due(self, mapper: Mapper, pose: Pose, now: float) -> bool:
        """Whether it is time to decide."""
        with self._blocked_lock:
            blocked, self._blocked = self._blocked, ""
        course, schedule = self._course, self._schedule
        if course is None:
            # Nowhere to go: asked again on every new map, and not more often than the rate.
            return schedule.may_ask(now) and schedule.is_new(self._version)
        if blocked:
            self._supervisor.give_up(course, blocked, now)
            return True
        if self._checkup.waypoint_occupied or self._arrived(mapper, pose):
            return True
        wanted = self._config.replan == "always" or self._seen(mapper, course.goal) or self._at_end(course, pose)
        return wanted and schedule.may_ask(now) and schedule.has_news(pose, mapper.belief.known_cells)

    def _seen(self, mapper: Mapper, goal: Position) -> bool:
        """Whether nothing is left to see from where the robot is going."""
        return goal != self._supervisor.target and nothing_to_see(mapper, goal, self._mapping.viewpoint_spacing)

    def _at_end(self, course: Course, pose: Pose) -> bool:
        """Whether the robot stands over the end of its route.

        It may have passed its waypoint at a distance, on a way around something: then it never arrives there.
        """
        return pose.distance_to(course.route[-1]) <= max(self._mapping.robot_radius, self._mapping.resolution)

    def _decide(self, mapper: Mapper, pose: Pose, now: float) -> bool:
        """Let a planner decide where to go, and watch over its choice."""
        self._mission.begun(pose.position)
        stands = self._schedule.stands(pose)
        self._schedule.note_asked(now, pose, self._version, mapper.belief.known_cells)
        if self._at_goal(pose):
            return False
        way = self._way_to_place(mapper, pose)
        place = Pose(*way[-1], pose.yaw) if way else pose
        try:
            look = self._supervisor.look_around(mapper, place, now) if way else None
            plan = look or self.planners.plan(mapper, place, now)
            if self._supervisor.begin_anew(plan, now):
                self.planners.begin_anew()
                plan = self.planners.plan(mapper, place, now)
        except PlannerError as error:
            self._checkup.planner_failed(error)
            self._stand(str(error))
            # The next pass asks the fallback.
            self._schedule.restart(now)
            return False
        self._checkup.planner_decided()
        if plan.status is Status.GOING and not self._supervisor.allows(plan, place, now):
            plan = self._supervisor.around(mapper, place, now)
        elif plan.status is not Status.GOING:
            plan = self._supervisor.second_look(mapper, place, plan, now)
        if plan.status is Status.GOING and plan.waypoint is not None:
            if not (stands and self._arrived(mapper, pose)):
                plan = begun_at(mapper, pose, way, plan)
            self._go(mapper, pose, plan, place, now)
        else:
            self._nowhere(mapper, place, plan)
        return True

    def _way_to_place(self, mapper: Mapper, pose: Pose) -> list[Position]:
        """Return the way to where the planner shall take the robot to be, with the mapper updated there; mostly empty.

        A robot that came as near to its waypoint as it was asked to counts as being on it. One that does not fit where
        it stands, by the map, counts as being at the nearest place where it does.
        """
        if self._course is not None and self._arrived(mapper, pose):
            waypoint = self._course.waypoint
            mapper.update(Pose(*waypoint, pose.yaw))
            if not mapper.stuck:
                return [waypoint]
        mapper.update(pose)
        return way_out(mapper, pose, 2.0 * self._mapping.viewpoint_spacing) if mapper.stuck else []

    def _arrived(self, mapper: Mapper, pose: Pose) -> bool:
        """Whether the robot is near its waypoint, and no wall is between the two."""
        course = self._course
        return (
            course is not None
            and pose.distance_to(course.waypoint) <= self._config.arrival_radius
            and (not course.via or mapper.segment_free(pose.position, course.waypoint))
        )

    # Going.

    def _go(self, mapper: Mapper, pose: Pose, plan: Plan, place: Pose, now: float) -> None:
        """Set out for a waypoint, and look whether the robot gets anywhere."""
        assert plan.waypoint is not None
        waypoint = plan.waypoint
        self._checks.reset()
        self._hold = ""
        old = self._course
        reached = old.waypoint if old is not None and self._arrived(mapper, pose) else None
        self._course = Course(
            waypoint=waypoint,
            beacon=plan.beacon,
            via=tuple(plan.via),
            path=tuple(plan.path),
            route=drivable(mapper, plan, lambda start, end: self._supervisor.may_enter(start, end, now)),
            with_room=mapper.has_room(waypoint),
            reason=plan.reason,
        )
        self._aim = Aim(pose, [*plan.via, waypoint], self._config.arrival_radius)
        self._watch(self._course, mapper, place, reached, now)

    def _watch(self, course: Course, mapper: Mapper, place: Pose, reached: Position | None, now: float) -> None:
        """Look whether the robot gets anywhere, and try something else when it does not."""
        vain = self._supervisor.watch(mapper, place, course, reached, now)
        if not vain:
            return
        if self._motion.problem:
            vain = self._motion.problem
            self._supervisor.wait(now)
        else:
            self._supervisor.give_up(course, vain, now)
        self.planners.relieve(now, vain)
        # It was to move all the time.
        self._course = self._aim = None
        self._hold = vain
        self._schedule.restart(now)

    # Standing.

    def _nowhere(self, mapper: Mapper, place: Pose, plan: Plan) -> None:
        """Stand, because the planner has no waypoint; after enough checks the task is over."""
        found = diagnose(mapper, place, self._mapping)
        orders = self._mission.orders
        exploring = not orders.task.needs_target and orders.phase is not Phase.RETURNING
        if plan.status is Status.STUCK or (exploring and not found.final):
            self._checks.reset()
            self._stand(plan.reason if found.final else found.text)
            return
        if exploring and found.unseen is None:
            found = behind_closed_way(self._supervisor.behind_closed_way(mapper)) or found
        text = f"{found.text} ({plan.reason})" if exploring else plan.reason
        done = exploring or plan.status is Status.COMPLETE
        if self._checks.passed(self._version, self._clock()):
            self._unseen = found.unseen if exploring else None
            self._end(Phase.FINISHED if done else Phase.FAILED, text)
        else:
            self._stand(f"check {self._checks.count} of {self._checks.needed}: {text}")

    def _at_goal(self, pose: Pose) -> bool:
        """End the task when the robot is at its target, or home, and when the target is out of reach."""
        orders = self._mission.orders
        returning = orders.phase is Phase.RETURNING
        goal = orders.home if returning else orders.target
        if goal is None or pose.distance_to(goal) > self._config.goal_radius:
            # A target of the configuration is first measured here, and a way home is always as far as it is.
            far = "" if goal is None or returning else too_far(goal, pose.position, self._config.goal_reach)
            if far:
                self._end(Phase.FAILED, far)
            return bool(far)
        what = "back where it began" if returning else "at its target"
        self._end(Phase.FINISHED, f"the robot is {what}, {pose.distance_to(goal):.2f} m from the very point")
        return True

    def _end(self, phase: Phase, text: str) -> None:
        log.log(logging.INFO if self._unseen is None else logging.WARNING, "%s: %s", phase, text)
        self._stand("")
        orders = self._mission.orders
        whole = orders.phase is not Phase.RETURNING and orders.task is self._mission.task
        if phase is Phase.FINISHED and self._config.return_home and whole:
            self._mission.return_home(f"the task is done: {text}")
        else:
            self._mission.end(phase, text, self._episode)

    def _stand(self, why: str) -> None:
        self._motion.reset()
        self._course = self._aim = None
        self._hold = why

    def _outcome(self, mapper: Mapper | None, pose: Pose | None, now: float, decided: bool, seconds: float) -> Outcome:
        orders = self._mission.orders
        aim = None
        if orders.moving and self._aim is not None and mapper is not None and pose is not None:
            aim = self._aim.advance(mapper, pose)
        return Outcome(
            orders=orders,
            hold=self._hold if orders.moving else "",
            course=self._course if orders.moving else None,
            aim=aim,
            planner=self.planners.in_charge(now).name,
            relieved=self.planners.why_relieved if self.planners.relieved(now) else "",
            decided=decided,
            seconds=seconds,
            faults=tuple(self._checkup.faults),
            mapper=mapper,
            pose=pose,
            checks=self._checks.count,
            bans=self._supervisor.bans(now),
            unseen=self._unseen,
        )
