"""What people see of a real actor's episodes, over a real bus."""

import numpy as np

from common.bus.session import open_viewer_session
from common.bus.views import ViewWatcher
from common.config import BusConfig
from tests.actors.learner_end import LearnerEnd, free_port
from tests.actors.test_worker import Running


def test_an_actor_shows_its_episode_a_few_times_a_second_while_somebody_looks():
    with (
        LearnerEnd(free_port()) as learner,
        Running(learner.endpoint),
        ViewWatcher(open_viewer_session(BusConfig(), [learner.endpoint]), "test") as watcher,
    ):
        watcher.look_at({("actor", "desk-0")})
        seen = []
        assert learner.wait_for(lambda: seen.extend(watcher.views().values()) or len(seen) >= 3)
        for view in seen:
            assert (view.actor, view.task, view.family) == ("desk-0", "exploration", "worlds")
            assert set(np.unique(view.cells)) <= {-1, 0, 100}
            assert len(view.viewpoints) == len(view.kinds) > 0
            if not view.ended:
                assert np.abs(view.beacons - view.beacon).sum(axis=1).min() < 1e-3, "one of the beacons is chosen"
                assert np.abs(view.viewpoints - view.waypoint).sum(axis=1).min() < 1e-3
            row, column = ((view.way[-1] - view.origin) / view.resolution).astype(int)[::-1]
            assert view.cells[row, column] == 0, "the robot stands where it knows to be free"


def test_an_evaluator_shows_how_each_episode_ended():
    with (
        LearnerEnd(free_port()) as learner,
        ViewWatcher(open_viewer_session(BusConfig(), [learner.endpoint]), "test") as watcher,
        Running(learner.endpoint, evaluate=True, restarts=2, last_error="was killed by SIGKILL"),
    ):
        ended = []
        assert learner.wait_for(lambda: ended.extend(watcher.outcomes()) or len(ended) >= 2)
        reports = {delivery.body.map_name: delivery.body for delivery in learner.deliveries}
        for view in ended[:2]:
            assert (view.ended, view.version) == (True, 1)
            assert abs(view.distance - reports[view.world].distance) < 1e-6
        assert learner.wait_for(lambda: ("evaluator", "desk-0") in learner.stats.rows())
        row, _ = learner.stats.rows()["evaluator", "desk-0"]
        assert (row.restarts, row.last_error) == (2, "was killed by SIGKILL")
