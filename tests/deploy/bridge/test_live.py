"""A policy that follows a learner on the bus."""

import time

import pytest

from common.bus.session import open_learner_session
from common.bus.spec import SpecServer
from common.bus.weights import WeightsPublisher
from common.config.load import load_config
from common.errors import ConfigError
from common.messages.replies import Spec
from common.messages.weights import Weights
from common.network.parameters import initial_parameters
from deploy.bridge.live import LivePolicy
from deploy.bridge.planner_selector import make_planners
from tests.common.bus.processes import eventually, loopback
from tests.common.planners.worlds import ROOMS
from tests.deploy.bridge.offline import MAPPING, Trial, settings

SMALL = ["network.width=16", "network.heads=2", "network.layers=1", "name=office"]


def weights(config, version, seed=0):
    return Weights.of(initial_parameters(config.network, seed), learner=5, version=version, updates=version)


def live_policy(config):
    return LivePolicy(config.decision, config.mapping)


def follow(bus):
    return settings(decision={"planner": "greedy", "live_run": "office", "live_connect": [bus.listen]})


def test_weights_are_taken_over_between_decisions_and_the_robot_never_waits_for_them():
    bus = loopback()
    config = follow(bus)
    run = load_config(overrides=SMALL)
    trial = Trial(ROOMS, config)
    trial.mission.start()
    with live_policy(config) as live:
        live.refresh(trial.planners)
        assert trial.run(1).planner == "greedy"
        with (
            open_learner_session(bus) as session,
            SpecServer(session, Spec("office", 5, run.model_dump_json())),
            WeightsPublisher(session, "office") as publisher,
        ):
            publisher.publish(weights(run, 3))
            assert eventually(lambda: live.refresh(trial.planners) or live.version == 3)
            outcome = trial.run(1)
            assert outcome.planner == "hdplanner"
            assert outcome.course is not None
            attention = trial.planners.main.attention
            assert attention.waypoint_probabilities.sum() == pytest.approx(1.0, abs=1e-3)
            assert len(attention.beacons) == len(attention.beacon_probabilities)
            publisher.publish(weights(run, 4, seed=1))
            assert eventually(lambda: live.refresh(trial.planners) or live.version == 4)
            assert trial.planners.main.policy.version == 4
        # The learner has gone: its last policy still decides.
        live.refresh(trial.planners)
        assert trial.run(1).planner == "hdplanner"


def test_weights_of_another_network_are_refused_and_the_policy_stays():
    bus = loopback()
    config = follow(bus)
    run = load_config(overrides=SMALL)
    planners = make_planners(config)
    with (
        live_policy(config) as live,
        open_learner_session(bus) as session,
        SpecServer(session, Spec("office", 5, run.model_dump_json())),
        WeightsPublisher(session, "office") as publisher,
    ):
        publisher.publish(weights(run, 1))
        assert eventually(lambda: live.refresh(planners) or live.version == 1)
        publisher.publish(weights(load_config(overrides=[*SMALL, "network.width=32"]), 2))
        time.sleep(0.5)
        live.refresh(planners)
        assert live.version == 1


def test_a_run_of_the_other_task_is_refused(caplog):
    bus = loopback()
    config = follow(bus)
    run = load_config(overrides=[*SMALL, "task.name=navigation"])
    with (
        live_policy(config) as live,
        open_learner_session(bus) as session,
        SpecServer(session, Spec("office", 5, run.model_dump_json())),
    ):
        assert eventually(lambda: "trains for navigation, this robot is to do exploration" in caplog.text)
        assert live.version == -1


def test_a_run_without_an_endpoint_is_refused():
    with pytest.raises(ConfigError, match="live_connect"):
        live_policy(settings(decision={"live_run": "office"}, mapping=MAPPING))


def test_a_learner_cannot_make_a_robot_import_a_module(caplog):
    bus = loopback()
    run = load_config(overrides=[*SMALL, "task.name=foreign_code:TASK"])
    with (
        live_policy(follow(bus)) as live,
        open_learner_session(bus) as session,
        SpecServer(session, Spec("office", 5, run.model_dump_json())),
    ):
        assert eventually(lambda: "names the task 'foreign_code:TASK'" in caplog.text)
        assert live.version == -1
    assert "No module named" not in caplog.text


def test_a_run_in_somebodys_own_simulator_can_be_followed():
    bus = loopback()
    config = follow(bus)
    run = load_config(overrides=[*SMALL, "simulator.name=foreign_code:Simulator", "maps.train=generator:foreign:Maze"])
    planners = make_planners(config)
    with (
        live_policy(config) as live,
        open_learner_session(bus) as session,
        SpecServer(session, Spec("office", 5, run.model_dump_json())),
        WeightsPublisher(session, "office") as publisher,
    ):
        publisher.publish(weights(run, 1))
        assert eventually(lambda: live.refresh(planners) or live.version == 1)
