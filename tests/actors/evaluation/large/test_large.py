"""From the command to table, pictures and recount, in small worlds."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("pybullet")

from actors.evaluation.cli import app
from actors.evaluation.large.results import read_large_results
from actors.evaluation.large.robot import LIDAR, TRACKING_ROOM
from actors.maps.generators import make_generator
from actors.maps.grid_map import GridMap
from actors.maps.png import write_png
from actors.simulators.dynamic import DynamicSimulator
from common.config import SimulatorConfig
from common.geometry import Pose

SMALL = "generator:building?width=144&height=144&lobbies=1"


def call(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def exploration(tmp_path_factory):
    out = tmp_path_factory.mktemp("exploration")
    result = call("large", "--planner", "greedy", "--world", SMALL, "--seeds", 1, "--jobs", 1, "--out", out)
    assert result.exit_code == 0, result.output
    return out


@pytest.fixture(scope="module")
def tour(tmp_path_factory):
    out = tmp_path_factory.mktemp("tour")
    # The targets of a tour are drawn: a plan with a start alone will do.
    plan = tmp_path_factory.mktemp("plan") / "plan.png"
    world = make_generator("building", {"width": "144", "height": "144", "lobbies": "1"}).world(0, 0.25)
    write_png(replace(world, target=None, target_region=None), plan)
    where = ["--world", plan, "--jobs", 1, "--targets", 2]
    result = call("large", "--planner", "astar", "--task", "navigation", "--robot-radius", 0.25, *where, "--out", out)
    assert result.exit_code == 0, result.output
    return out


def test_an_exploration_is_complete_and_counted(exploration):
    results = read_large_results(exploration / "greedy.json")
    (episode,) = results.episodes
    assert episode.success and episode.explored_rate > 0.97
    assert len(episode.decision_ms) >= episode.steps and min(episode.decision_ms) > 0.0
    # Not faster than 2 m/s, and not much slower than one stop a waypoint makes it.
    assert 0.5 < episode.distance_m / episode.time_s <= 2.0
    # A scan every fifth of a second, and one at each waypoint.
    assert len(episode.track) >= 5.0 * episode.time_s
    volumes = [volume for _, _, volume, _ in episode.curve]
    assert volumes == sorted(volumes) and volumes[-1] == episode.volume_m3 > 150.0
    # The floor that was seen is one layer of voxels; walls add to it.
    assert episode.volume_m3 < 0.5 * 36.0 * 36.0


@pytest.mark.slow
def test_a_robot_that_replans_once_its_goal_is_seen_stops_on_its_way(tmp_path):
    where = ["--world", SMALL, "--seeds", 1, "--jobs", 1, "--out", tmp_path]
    result = call("large", "--planner", "tour", "--replan", "seen", *where)
    assert result.exit_code == 0, result.output
    results = read_large_results(tmp_path / "tour.json")
    (episode,) = results.episodes
    assert episode.success and results.settings["replan"] == "seen"
    assert call("large-recount", tmp_path).exit_code == 0
    result = call("large", "--planner", "tour", *where)
    assert result.exit_code == 1 and "replan" in result.output, "other settings are another run"


def test_a_tour_visits_all_targets(tour):
    results = read_large_results(tour / "astar.json")
    (episode,) = results.episodes
    assert episode.success and len(episode.legs) == 2
    assert sum(leg.distance_m for leg in episode.legs) == pytest.approx(episode.distance_m, abs=0.01)
    assert sum(leg.time_s for leg in episode.legs) == pytest.approx(episode.time_s, abs=0.01)
    assert sum(leg.steps for leg in episode.legs) == episode.steps
    assert results.settings["mapping"]["robot_radius"] == pytest.approx(0.25 + TRACKING_ROOM)
    assert episode.collisions == 0


@pytest.mark.parametrize("slope", [-0.3, -0.11, 0.0, 0.11, 0.3])
def test_a_robot_led_past_a_corner_at_its_radius_and_the_room_for_tracking_does_not_touch_it(slope):
    free = np.ones((24, 32), dtype=np.bool_)
    free[8:11, 14:17] = False
    world = GridMap("column", free, 0.25, (0.0, 0.0), (1.0, 1.0), None, None, (0.0, 0.0))
    # Along a line so far from the column, to the nearest of its upper corners.
    gap = (0.25 + TRACKING_ROOM) * math.hypot(1.0, slope)
    x, y = (4.25 if slope < 0.0 else 3.5), 2.75 + gap
    simulator = DynamicSimulator(SimulatorConfig(**LIDAR), 20.0)
    try:
        simulator.reset(world, 0)
        simulator.place(Pose(x + 2.0, y + 2.0 * slope, -1.6))
        leg = simulator.drive_to((x - 2.0, y - 2.0 * slope))
    finally:
        simulator.close()
    assert leg.reached
    assert leg.collisions == 0


def test_the_same_command_again_has_nothing_to_do(exploration):
    before = (exploration / "greedy.jsonl").read_bytes()
    result = call("large", "--planner", "greedy", "--world", SMALL, "--seeds", 1, "--jobs", 1, "--out", exploration)
    assert result.exit_code == 0
    assert (exploration / "greedy.jsonl").read_bytes() == before
    result = call("large", "--planner", "greedy", "--world", SMALL, "--robot-radius", 0.3, "--out", exploration)
    assert result.exit_code == 1
    assert "robot_radius" in result.output


def test_the_table_tells_what_matters(exploration, tour):
    result = call("large-table", exploration, "--baseline", "greedy", "--format", "markdown")
    assert result.exit_code == 0, result.output
    head, _, row = result.output.splitlines()[:3]
    assert "volume / distance" in head and "collisions / km" in head and "time [s]" in head
    assert row.startswith("| greedy | 1 | 100 % |")
    assert "440 rays at 5 Hz" in result.output
    lines = call("large-table", tour, "--format", "csv").output.splitlines()
    assert "targets" in lines[0] and "2 of 2" in lines[1]


def test_pictures_are_drawn(exploration, tour, tmp_path):
    assert call("large-plot", exploration, "--out", tmp_path).exit_code == 0
    assert call("large-plot", tour, "--out", tmp_path / "tour").exit_code == 0
    assert sorted(path.name.split("-")[0] for path in tmp_path.glob("*.png")) == ["tracks", "volume.png"]
    assert len(list((tmp_path / "tour").glob("tracks-*.png"))) == 1


def test_a_recount_agrees_and_finds_what_was_changed(exploration, tour, tmp_path):
    for folder in (exploration, tour):
        result = call("large-recount", folder)
        assert result.exit_code == 0, result.output
        assert "1 of 1 episodes agree" in result.output
    values = json.loads((exploration / "greedy.json").read_text())
    episode = values["episodes"][0]
    episode["distance_m"] *= 0.9
    episode["volume_m3"] *= 1.1
    episode["explored_rate"] -= 0.02
    (tmp_path / "greedy.json").write_text(json.dumps(values))
    output = call("large-recount", tmp_path).output
    assert "0 of 1 episodes agree" in output
    assert all(word in output for word in ("distance_m says", "volume_m3 says", "explored_rate says"))
    values = json.loads((tour / "astar.json").read_text())
    values["episodes"][0]["legs"][1]["target"] = values["episodes"][0]["track"][0][1:3]
    (tmp_path / "greedy.json").write_text(json.dumps(values))
    assert "target 2 is recorded as reached" in call("large-recount", tmp_path).output


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--planner", "gredy", "--out", "x"], "did you mean 'greedy'"),
        (["--planner", "greedy", "--task", "navigation", "--out", "x"], "planners for it are"),
        (["--planner", "greedy", "--set", "simulator.fidelity=kinematic", "--out", "x"], "hd-eval run"),
        (["--planner", "greedy", "--set", "simulator.lidar_layers=1", "--out", "x"], "3D lidar"),
    ],
)
def test_mistakes_are_one_clear_line(arguments, word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call("large", *arguments)
    assert result.exit_code == 1
    assert word in result.output.replace("\n", " ")
    assert "Traceback" not in result.output


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_real_size(tmp_path):
    result = call("large", "--planner", "greedy", "--seeds", 1, "--jobs", 1, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    (episode,) = read_large_results(tmp_path / "greedy.json").episodes
    assert episode.success and episode.distance_m > 500.0
    assert call("large-recount", tmp_path).exit_code == 0
