import json

import numpy as np
import pytest

from deploy.bridge.scene import scene
from tests.common.planners.worlds import ARMS
from tests.deploy.bridge.offline import Trial, settings


def positions(flat, stride):
    return np.array(flat, float).reshape(-1, stride)[:, :2] / 100.0


def test_a_scene_holds_what_the_planner_sees():
    trial = Trial(ARMS, settings())
    assert scene(trial.loop.step(), trial.planners.main) is None
    trial.mission.start()
    outcome = trial.run(20.0, until=lambda outcome: outcome.course is not None)
    mapper = outcome.mapper
    told = scene(outcome, trial.planners.in_charge(trial.now))
    found = json.loads(told.data)
    assert positions(found["viewpoints"], 3) == pytest.approx(mapper.viewpoints, abs=0.005)
    useful = np.array(found["viewpoints"]).reshape(-1, 3)[:, 2] == 2
    assert np.array_equal(useful, mapper.observe().utility[: len(useful)] > 0)
    assert positions(found["frontiers"], 2) == pytest.approx(mapper.frontiers, abs=0.005)
    assert found["cell"] == 50
    attention = trial.planners.main.attention
    beacons = np.array(found["beacons"]).reshape(-1, 3)
    if attention is None:
        assert set(beacons[:, 2]) == {-1}
    else:
        assert beacons[:, 2] == pytest.approx(1000 * attention.beacon_probabilities, abs=0.51)
        assert positions(found["waypoints"], 3) == pytest.approx(attention.waypoints, abs=0.005)
