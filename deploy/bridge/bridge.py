"""The bridge process: wires inputs, decision and driving loop, commands and outputs together, and keeps them going."""

from __future__ import annotations

import logging
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Final

from common.bus.control import ControlServer
from common.bus.liveness import declare_presence
from common.messages.replies import ROBOT_VERBS
from common.system.closing import Closing
from common.system.logs import lasting
from deploy.bridge.alone import NameProbe, Rivals, new_instance
from deploy.bridge.commands import Commands, TopicCommands
from deploy.bridge.decision import DecisionLoop
from deploy.bridge.drawing import draw
from deploy.bridge.driving_loop import DrivingLoop
from deploy.bridge.inputs import Inputs
from deploy.bridge.lifecycle_services import LifecycleServices
from deploy.bridge.live import LivePolicy
from deploy.bridge.metrics import Metrics
from deploy.bridge.mission import WAITS, Mission, Phase
from deploy.bridge.navigate_action import NavigateAction
from deploy.bridge.outcome import Outcome
from deploy.bridge.outputs import Outputs
from deploy.bridge.planner_selector import make_planners, with_planning_set
from deploy.bridge.problems import LastProblem
from deploy.bridge.reporter import Reporter
from deploy.bridge.type_watch import TypeWatch
from deploy.bridge.velocity_watch import VelocityWatch
from deploy.bridge.warmup import warm_up
from deploy.config import DeployConfig
from deploy.mapping.robot_map import RobotMap
from deploy.ros2 import Message, Node, Received
from deploy.safety.awaited import awaited
from deploy.safety.gate import VelocityGate, WatchdogProcess, behind_watchdog
from deploy.safety.geofence import Geofence
from deploy.safety.health import HealthMonitor
from deploy.safety.inputs import STOPS
from deploy.safety.lifecycle import Lifecycle, LifecycleState

log = logging.getLogger(__name__)

# Passes of the decision loop per second: what it must notice (a waypoint that is free no more) stops the robot within
# half a second.
_PASSES: Final = 10.0
# A thread gives way to another this soon, seconds: the driving loop must not wait for a planner's arithmetic.
_SWITCH_INTERVAL: Final = 0.001
# Phases in which nothing is asked of the robot; paused and aborted it has to stand.
_FREE: Final = frozenset({Phase.IDLE, Phase.FINISHED, Phase.FAILED})


class Bridge(Closing):
    """One bridge.

    Usage::

        with Bridge(config) as bridge:
            bridge.run(stop)
    """

    def __init__(self, config: DeployConfig) -> None:
        """Load the planners, start the watchdog and join the network: from unconfigured to inactive.

        Raises:
            HDError: a planner, a topic, an endpoint or the watchdog cannot be had; the message says what to do.
        """
        self._config = config
        self._parts = ExitStack()
        self._lifecycle = Lifecycle()
        self._ended = threading.Event()
        self._passes = True
        self._problems = self._parts.enter_context(LastProblem())
        try:
            with self._lifecycle.transition("configure"):
                self._configure()
        except BaseException:
            self._parts.close()
            raise

    def run(self, stop: threading.Event) -> None:
        """Decide until `stop` is set, or somebody shuts the bridge down as a lifecycle node."""
        due = time.monotonic()
        while not (stop.wait(max(0.0, due - time.monotonic())) or self._ended.is_set()):
            due = max(due + 1.0 / _PASSES, time.monotonic())
            try:
                self._pass()
                self._passes = True
            except Exception as error:
                # The robot stands and the next pass tries again; what went wrong is told by the status.
                self._passes = False
                log.exception("a pass of the decision loop failed", extra=lasting(lambda: not self._passes))
                self._driving.stand(f"a pass of the decision loop failed: {error}")

    def close(self) -> None:
        """Stop the robot and leave: to finalized. Safe to call twice."""
        if self._lifecycle.state is LifecycleState.FINALIZED:
            return
        with self._lifecycle.transition("shutdown"):
            self._parts.close()

    def status(self) -> dict[str, Any]:
        """Return the state of this moment, ready for JSON."""
        outcome, orders = self._outcome, self._mission.orders
        if orders is not outcome.orders:
            # What held the robot, or where it went, by its old orders says nothing about new ones; a fault does.
            held = outcome.hold if outcome.faults or self._rivals.problem else ""
            outcome = replace(outcome, orders=orders, hold=held, course=None, aim=None)
        return self._reporter.status(outcome, self._lifecycle.state.label, self._gate.state).to_json()

    def _configure(self) -> None:
        config, enter = self._config, self._parts.enter_context
        sys.setswitchinterval(_SWITCH_INTERVAL)
        fence = Geofence.around_robot(config)
        # It imports while this process prepares what decides.
        watchdog = enter(WatchdogProcess())
        # A bridge that is the router itself has a network of its own.
        probe = None if config.ros.listen else enter(NameProbe(config.name, config.ros))
        self._live = (
            enter(LivePolicy(config.decision, config.mapping)) if config.decision.live_run is not None else None
        )
        self._planners = make_planners(config)
        decision = config.decision
        targets = Geofence(config.safety.geofence, config.mapping.robot_radius)
        self._mission = Mission(
            decision.task,
            decision.goal,
            decision.goal_reach,
            self._position,
            permits=lambda target: targets.comes_near(target, decision.goal_radius),
            waits="starts by itself with a map and a pose" if decision.autostart else WAITS,
        )
        warm_up(config, self._planners.members(config.decision.task))
        if probe is not None:
            # Before the watchdog begins: its zeros would stop the other bridge's robot.
            probe.check()
        self._map = RobotMap(with_planning_set(config, self._planners), self._mission.orders.target)
        self._health = HealthMonitor(config.safety, fence, config.sensing.source, awaited(config))
        self._inputs = Inputs(config, self._map, self._health)
        self._loop = DecisionLoop(
            decision, config.mapping, config.safety, self._map, self._planners, self._mission, self._health
        )
        self._metrics = Metrics()
        self._gate = enter(VelocityGate(config, watchdog))
        node = enter(Node(behind_watchdog(config.ros), remap=config.topics.remap))
        self._gate.use_when_watchdog_dies(node)
        if config.topics.emergency_stop:
            # The watchdog hears it sooner, but not while it is dead and another one starts.
            node.subscribe(config.topics.emergency_stop, "std_msgs/msg/Bool", self._heard_emergency_stop, STOPS)
        self._outputs = Outputs(node, config)
        self._outcome = self._loop.step()
        instance = new_instance()
        self._reporter = Reporter(
            config.name,
            decision.live_run,
            self._inputs,
            self._metrics,
            self._map,
            self._planners,
            self._problems,
            instance,
        )
        self._driving = enter(
            DrivingLoop(
                config.driving,
                decision.rate,
                self._map,
                self._health,
                self._gate,
                velocity=lambda: self._inputs.velocity,
                may_move=lambda: self._mission.orders.moving,
                on_blocked=self._loop.report_blocked,
            )
        )
        self._inputs.subscribe(node)
        commands = Commands(self._mission, self._gate, self.status, self._health.try_again)
        TopicCommands(commands, node, config.topics, config.frames)
        LifecycleServices(node, self._lifecycle, commands, self._ended.set)
        self._action: NavigateAction | None = None
        if config.topics.navigate_action:
            action = NavigateAction(
                node,
                config.topics.navigate_action,
                commands,
                self._mission,
                map_frame=config.frames.map,
                goal_radius=decision.goal_radius,
            )
            self._action = enter(action)
        enter(ControlServer(node.session, config.name, commands, ROBOT_VERBS))
        enter(declare_presence(node.session, config.name, "robot", config.name))
        self._rivals = enter(Rivals(node.session, config.name, instance))
        if config.driving.enabled:
            enter(VelocityWatch(node, config.ros, config.topics))
        enter(TypeWatch(node.session, config))
        self._next_status = self._next_picture = 0.0
        self._started_by_itself = False

    def _heard_emergency_stop(self, stop: Message, received: Received) -> None:
        del received
        if stop.data:
            self._gate.emergency_stop(self._config.topics.emergency_stop)

    def _position(self) -> tuple[float, float] | None:
        pose = self._map.pose
        return None if pose is None else pose.position

    def _pass(self) -> None:
        """Run one pass: decide, drive, tell."""
        now = time.monotonic()
        if self._gate.latched:
            self._mission.emergency_stop(self._gate.state.reason)
        if self._live is not None:
            self._live.refresh(self._planners)
        unheard = self._outputs.unheard(now, velocity_heard=self._gate.state.heard)
        outcome = self._outcome = self._loop.step(in_other_hands=bool(unheard) or self._gate.state.in_other_hands)
        held = self._rivals.problem or (unheard if outcome.orders.moving else "")
        if held:
            outcome = self._outcome = replace(outcome, hold=held, course=None, aim=None)
        if outcome.course is not None and not outcome.hold:
            self._driving.follow(outcome.course.route)
        else:
            orders = outcome.orders
            self._driving.stand(outcome.hold or orders.reason, free=orders.phase in _FREE)
        self._follow_orders(outcome)
        self._metrics.moved(now, self._inputs.travelled, under_way=outcome.orders.moving)
        if outcome.decided:
            self._metrics.decided(outcome.seconds)
        stamp = self._inputs.stamp
        self._outputs.decision(outcome, stamp, now)
        self._reporter.look(outcome)
        if now >= self._next_status:
            self._next_status = now + 1.0 / self._config.decision.status_rate
            status = self._reporter.status(outcome, self._lifecycle.state.label, self._gate.state)
            self._outputs.status(status, outcome, self._map.statistics.explored_volume, stamp, now)
            if self._action is not None:
                self._action.look(outcome, stamp, now)
        rate = self._config.decision.markers_rate
        if rate > 0.0 and now >= self._next_picture:
            self._next_picture = now + 1.0 / rate
            self._draw(outcome, stamp, now)

    def _follow_orders(self, outcome: Outcome) -> None:
        """Keep the lifecycle in step with the orders, and start by itself where that is wanted."""
        if outcome.orders.moving and self._lifecycle.state is LifecycleState.UNCONFIGURED:
            # An operator's start is as good as a manager's transitions.
            self._lifecycle.trigger("configure")
        state, moving = self._lifecycle.state, outcome.orders.moving
        if moving and state is LifecycleState.INACTIVE:
            self._lifecycle.trigger("activate")
        elif not moving and state is LifecycleState.ACTIVE:
            self._lifecycle.trigger("deactivate")
        if self._config.decision.autostart and not self._started_by_itself and outcome.mapper is not None:
            self._started_by_itself = True
            # What was latched meanwhile takes a start by command, as always.
            if self._gate.latched:
                self._mission.wait_for_start()
            else:
                self._mission.start()

    def _draw(self, outcome: Outcome, stamp: float, now: float) -> None:
        self._outputs.belief(outcome, stamp)
        spacing = self._config.mapping.viewpoint_spacing
        planner = self._planners.in_charge(now)
        self._outputs.scene(outcome, planner)
        drawn = draw(outcome, planner, stamp, self._config.frames.map, spacing)
        if drawn is not None:
            self._outputs.markers(drawn)
