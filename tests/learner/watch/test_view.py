import dataclasses
import io
import json
import logging
import time

import pytest
from rich.console import Console

from common.messages.replies import ControlReply
from common.messages.schema import decode, encode
from learner.run.episodes import EpisodeMeans
from learner.watch.status import ActorStatus, LearnerStatus
from learner.watch.view import View, line, render

ACTOR = ActorStatus(
    name="desk-0",
    role="actor",
    alive=True,
    host="desk",
    steps_per_second=61.2,
    steps=12_345,
    episodes=321,
    version=40,
    lag=2,
    lag_seconds=7.0,
    buffered=1,
    silent=0.3,
    state="acting",
    restarts=0,
    last_error="",
)
STATUS = LearnerStatus(
    run="office",
    folder="runs/office",
    endpoint="tcp/127.0.0.1:7447",
    state="training",
    device="cpu",
    uptime=100.0,
    steps=54_321,
    episodes=987,
    updates=3_394,
    total_updates=20_000,
    steps_per_second=122.5,
    updates_per_second=7.25,
    version=42,
    replay=54_000,
    replay_capacity=100_000,
    replay_fill=0.54,
    replay_bytes=130_000_000,
    ratio_declared=0.0625,
    ratio_actual=0.0624,
    ratio_lead=17.0,
    hold=0.0,
    next_checkpoint=123.0,
    last_checkpoint="000003200",
    best=37,
    best_figures={"distance": 248.5, "success": 1.0},
    evaluated=41,
    evaluated_figures={"distance": 250.25, "success": 1.0},
    refused=0,
    losses={"loss/critic": 0.512, "loss/policy": -1.25},
    late={"train": EpisodeMeans(100, 251.3, 0.97, 0.992, 3.5, 41.2, 0.0)},
    actors=[ACTOR, dataclasses.replace(ACTOR, name="desk-1", alive=False)],
)


def drawn(status: LearnerStatus, width: int) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(render(status))
    return console.file.getvalue()


@pytest.mark.parametrize("width", [80, 140])
def test_the_view_shows_every_figure_unshortened(width):
    text = drawn(STATUS, width)
    for figure in (
        "office", "training", "54,321 steps", "122.5/s", "3,394", "7.25/s", "0.0624", "declared 0.0625", "54%",
        "best 37", "at 3200", "next in 123 s", "loss/critic 0.512", "251.3 m", "97%", "99.2%", "61.2", "2 (7 s)",
        "12,345", "gone", "alive: 1 actor",
    ):  # fmt: skip
        assert figure in text, figure
    assert all(len(row) <= width for row in text.splitlines())


def test_long_states_shorten_no_figure():
    evaluator = dataclasses.replace(
        ACTOR, name="local-eval-0", role="evaluator", version=19, lag=1, state="evaluating version 19: world 63 of 100"
    )
    text = drawn(dataclasses.replace(STATUS, actors=[ACTOR, evaluator]), 80)
    assert "alive: 1 actor, 1 evaluator" in text
    row = next(row for row in text.splitlines() if row.startswith("local-eval-0"))
    assert row.split()[1:8] == ["61.2", "12,345", "19", "1", "(7", "s)", "0"]
    assert "evalua" in row
    assert all(len(line) <= 80 for line in text.splitlines())


def test_the_view_of_a_run_that_has_just_begun_has_no_holes():
    empty = dataclasses.replace(STATUS, losses={}, late={}, actors=[], updates=0, steps=0, best=-1, last_checkpoint="")
    text = drawn(empty, 80)
    for word in ("no update yet", "none yet", "none evaluated", "hd-actor"):
        assert word in text
    assert "0 actors" in line(empty)


def test_held_actors_are_said_in_view_and_line():
    held = dataclasses.replace(STATUS, hold=3.2)
    assert "actors wait 3.2 s" in drawn(held, 80)
    assert "actors held 3.2 s" in line(held)


def test_status_travels_as_json():
    again = LearnerStatus.from_json(json.loads(json.dumps(STATUS.to_json())))
    assert again == STATUS


def test_without_a_terminal_there_are_plain_lines(caplog):
    caplog.set_level(logging.INFO)
    console = Console(file=io.StringIO(), force_terminal=False)
    with View(lambda: STATUS, console, line_seconds=0.05):
        deadline = time.monotonic() + 5.0
        while "54,321 steps" not in caplog.text and time.monotonic() < deadline:
            time.sleep(0.02)
    assert "training, 54,321 steps (122.5/s), 3,394 updates (7.25/s), replay 54%" in caplog.text
    assert console.file.getvalue() == ""


def test_thousands_of_actors_come_page_by_page_and_none_twice():
    actors = [
        dataclasses.replace(ACTOR, name=f"desk-{number:05d}", host="ü" * 200, state="x" * 200) for number in range(3000)
    ]
    status = dataclasses.replace(STATUS, actors=actors)
    found, after, pages = [], "", 0
    while True:
        page = status.page(after)
        data = encode(ControlReply(True, "", page))
        body = decode(data, ControlReply).body
        found += LearnerStatus.from_json(body).actors
        pages += 1
        after = page["next"]
        if not after:
            break
    assert found == actors
    assert pages > 1
    assert LearnerStatus.from_json(dataclasses.replace(STATUS, actors=[]).page()).actors == []


def test_a_status_that_fails_ends_no_view(caplog):
    caplog.set_level(logging.INFO)
    times = []

    def status():
        times.append(1)
        if len(times) == 1:
            raise AttributeError("'LearnerStats' object has no attribute 'version_age'")
        return STATUS

    with View(status, Console(file=io.StringIO()), line_seconds=0.01):
        deadline = time.monotonic() + 10
        while "training, 54,321 steps" not in caplog.text and time.monotonic() < deadline:
            time.sleep(0.01)
    assert "the view of the learner failed and continues: AttributeError" in caplog.text
    assert "training, 54,321 steps" in caplog.text
