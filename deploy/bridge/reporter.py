"""Makes the status of what the parts of the bridge know."""

from __future__ import annotations

import time

from common.planners.learned import LearnedPlanner
from deploy.bridge.inputs import Inputs
from deploy.bridge.metrics import Metrics
from deploy.bridge.outcome import Outcome
from deploy.bridge.planner_selector import PlannerSelector
from deploy.bridge.problems import LastProblem
from deploy.bridge.status import Policy, Status, state_of
from deploy.mapping.robot_map import RobotMap
from deploy.safety.gate_state import GateState


class Reporter:
    """Knows the figures of the status; `look` belongs to the decision thread, `status` may be called from any."""

    def __init__(
        self,
        name: str,
        live_run: str | None,
        inputs: Inputs,
        metrics: Metrics,
        robot_map: RobotMap,
        planners: PlannerSelector,
        problems: LastProblem,
        instance: str,
    ) -> None:
        """Report on these parts of the bridge of this name and instance, which follows a live run or none."""
        self._instance = instance
        self._name = name
        self._live_run = live_run
        self._inputs = inputs
        self._metrics = metrics
        self._map = robot_map
        self._planners = planners
        self._problems = problems
        self._counts = (0, 0, 0)
        self._area = 0.0

    def look(self, outcome: Outcome) -> None:
        """Note the figures of the map after a decision, while its mapper holds still."""
        mapper = outcome.mapper
        if mapper is None:
            self._counts, self._area = (0, 0, 0), 0.0
        elif outcome.decided or not self._area:
            self._counts = len(mapper.viewpoints), len(mapper.frontiers), len(mapper.beacons)
            self._area = self._map.statistics.free_area or mapper.explored_area

    def status(self, outcome: Outcome, lifecycle: str, gate: GateState) -> Status:
        """Return the status after a pass of the decision loop."""
        now = time.monotonic()
        state, reason = state_of(outcome, gate)
        statistics = self._map.statistics
        pose, course, orders = outcome.pose, outcome.course, outcome.orders
        viewpoints, frontiers, beacons = self._counts
        return Status(
            name=self._name,
            instance=self._instance,
            lifecycle=lifecycle,
            state=state,
            reason=reason,
            task=orders.task.name,
            planner=outcome.planner,
            relieved=outcome.relieved,
            guard=self._guard(outcome),
            policy=self._policy(),
            faults={fault.kind.value: fault.reason for fault in outcome.faults},
            checks=outcome.checks,
            bans=len(outcome.bans),
            pose=None if pose is None else (pose.x, pose.y, pose.yaw),
            waypoint=None if course is None else course.waypoint,
            beacon=None if course is None else course.beacon,
            target=orders.target,
            home=orders.home,
            explored_area=self._area,
            distance=self._metrics.distance,
            duration=self._metrics.duration(now),
            decision_seconds=self._metrics.last_decision,
            decision_p95=self._metrics.decision_p95,
            viewpoints=viewpoints,
            frontiers=frontiers,
            unseen=outcome.unseen,
            beacons=beacons,
            ages=self._inputs.ages(),
            scans=statistics.integrated,
            dropped=statistics.dropped,
            gate=gate.mode.value if gate.alive else "watchdog_dead",
            gate_reason=gate.reason,
            emergency_stop=gate.emergency_stop,
            error=self._problems.problem,
        )

    def _guard(self, outcome: Outcome) -> str:
        planner = self._planners.main
        if isinstance(planner, LearnedPlanner) and outcome.planner == planner.name:
            return planner.guarded_by
        return ""

    def _policy(self) -> Policy | None:
        planner = self._planners.main
        if not isinstance(planner, LearnedPlanner) or planner.card is None:
            return None
        live = self._live_run is not None and planner.card.run == self._live_run
        return Policy(planner.card.run, planner.policy.version, live)
