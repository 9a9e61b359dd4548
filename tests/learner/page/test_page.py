"""The page of a training as a real process on a real bus, beside a learner that only tells."""

import contextlib
import dataclasses
import threading

import numpy as np
import pytest

from common.bus.control import ControlServer
from common.bus.session import open_client_session, open_learner_session
from common.bus.views import ViewPublisher
from common.errors import HDError
from common.page.options import PageSettings
from learner.page.process import start_page
from tests.common.bus.processes import eventually, loopback
from tests.common.messages import samples
from tests.common.page.reader import Reader
from tests.learner.runs import small_config
from tests.learner.watch.test_view import ACTOR, STATUS

pytest.importorskip("uvicorn", reason="the extra `page` is not installed")
TOKEN = "let-me-command"
DEAD = dataclasses.replace(ACTOR, name="desk-1", alive=False, restarts=3, last_error="was killed by SIGKILL")
JUDGE = dataclasses.replace(ACTOR, name="desk-eval-0", role="evaluator")


class Learner:
    """Answers as a learner does, and notes what it is told."""

    def __init__(self):
        self.status = dataclasses.replace(STATUS, actors=[ACTOR, DEAD, JUDGE])
        self.told = []

    def __call__(self, request):
        if request.verb == "checkpoint":
            raise HDError("the disk is full")
        if request.verb != "status":
            self.told.append(request.verb)
            self.status = dataclasses.replace(self.status, state={"pause": "paused"}.get(request.verb, "stopping"))
        return self.status.page(str(request.arguments.get("after", "")))


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    bus, learner = loopback(), Learner()
    config = small_config(bus=bus.model_dump())
    with (
        open_learner_session(bus) as session,
        ControlServer(session, config.name, learner),
        start_page(PageSettings(0, token=TOKEN, rate=20.0), config, tmp_path_factory.mktemp("run")) as page,
    ):
        yield bus, learner, page


@contextlib.contextmanager
def acting(bus, role, name, **changes):
    """An actor that shows itself to whoever looks, and how often it was asked to."""
    sent, stop = [], threading.Event()
    rng = np.random.default_rng(2)
    view = samples.view(rng)
    values = {field: getattr(view, field) for field in view.__slots__}
    with open_client_session(bus) as session, ViewPublisher(session, "test", role, name) as publisher:

        def act():
            while not stop.wait(0.02):
                made = type(view)(**values | {"actor": name, "step": len(sent)} | changes)
                outcome = made.ended
                if publisher.outcomes_wanted if outcome else publisher.looked_at:
                    publisher.send(made, outcome=outcome)
                    sent.append(made)

        thread = threading.Thread(target=act)
        thread.start()
        try:
            yield sent
        finally:
            stop.set()
            thread.join()


def test_the_page_tells_what_the_learner_and_its_actors_do(rig):
    _, learner, page = rig
    with Reader(page.address, channels=["run", "status", "actors", "curve-*"]) as reader:
        reader.until(lambda: "actors" in reader.values and "curve-points" in reader.series)
        assert reader.hello["page"] == "training"
        status, actors = reader.values["status"], {actor["name"]: actor for actor in reader.values["actors"]}
        assert (status["updates"], status["best_figures"]["distance"], "actors" in status) == (3394, 248.5, False)
        assert (actors["desk-0"]["lag"], actors["desk-0"]["steps_per_second"]) == (2, 61.2)
        assert (actors["desk-1"]["alive"], actors["desk-1"]["restarts"]) == (False, 3)
        run = reader.values["run"]
        assert (run["problem"], run["alive"], run["gone"]) == ("", {"actor": 1, "evaluator": 1}, 1)
        row = reader.series["curve-points"][0][-1]
        tags = dict(zip(reader.values["curve-tags"], row[2:], strict=True))
        assert row[1] == 3394
        assert (tags["episode_train/distance"], tags["evaluation/distance"], tags["loss/policy"]) == (
            251.3,
            250.25,
            -1.25,
        )
        learner.status = dataclasses.replace(learner.status, actors=[JUDGE])
        reader.until(lambda: [actor["name"] for actor in reader.values["actors"]] == ["desk-eval-0"])
        learner.status = dataclasses.replace(learner.status, actors=[ACTOR, DEAD, JUDGE])


def test_an_actor_shows_its_episode_only_while_somebody_looks(rig):
    bus, _, page = rig
    with acting(bus, "actor", "desk-0") as sent, Reader(page.address, channels=["status", "actors"]) as reader:
        reader.until(lambda: "actors" in reader.values)
        assert sent == []
        reader.watch("status", "actors", "actor/desk-0/*")
        view = reader.until(lambda: reader.values.get("actor/desk-0/view"))
        grid = reader.until(lambda: reader.grids.get("actor/desk-0/belief"))
        shown = sent[view["step"]]
        assert view["beacons"] == np.rint(100.0 * shown.beacons).astype(int).ravel().tolist()
        assert (view["world"], view["cell"], len(view["edges"])) == ("rooms-7", 50, 4 * len(shown.edges))
        assert np.array_equal(grid.cells(shown.cells.shape, shown.origin), shown.cells)
        reader.watch("status", "actors")
        settled = []

        def silent():
            settled.append(len(sent))
            return len(settled) > 20 and settled[-1] == settled[-20]

        assert eventually(silent), "nobody looks any more"


def test_evaluations_are_shown_world_by_world_with_their_newest_picture(rig):
    bus, _, page = rig
    ends = {"ended": True, "success": True, "version": 41}
    with (
        acting(bus, "evaluator", "desk-eval-0", **ends),
        Reader(page.address, channels=["evaluations", "world/*"]) as reader,
    ):
        (world,) = reader.until(lambda: reader.values.get("evaluations"))
        assert (world["world"], world["seen"], world["results"][-1]) == ("rooms-7", True, [41, 1, 31.5, 0.25])
        assert reader.until(lambda: reader.values.get(f"world/{world['id']}/view"))["success"]
        assert reader.until(lambda: reader.grids.get(f"world/{world['id']}/belief")).frames


def test_commands_reach_the_learner_and_refusals_the_browser(rig):
    _, learner, page = rig
    with Reader(page.address, channels=["status"]) as reader:
        assert not reader.command("pause")["ok"]
    assert learner.told == []
    with Reader(page.address, token=TOKEN, channels=["status"]) as reader:
        assert reader.command("pause")["state"]["state"] == "paused"
        reader.until(lambda: reader.values.get("status", {}).get("state") == "paused")
        assert "the disk is full" in reader.command("checkpoint")["error"]
        assert reader.command("stop")["ok"]
    assert learner.told == ["pause", "stop"]
    learner.status = dataclasses.replace(learner.status, state="training")


def test_a_learner_that_is_gone_is_said_to_be_silent(rig, tmp_path):
    bus, _, _ = rig
    config = small_config(bus=bus.model_dump(), name="nobody")
    with (
        start_page(PageSettings(0, rate=20.0), config, tmp_path) as page,
        Reader(page.address, channels=["run"]) as reader,
    ):
        run = reader.until(lambda: (found := reader.values.get("run")) and found["problem"] and found)
    assert (run["name"], run["silent"]) == ("nobody", 0)
    assert "no learner of the run 'nobody' answered" in run["problem"]
