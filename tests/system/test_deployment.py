"""A simulated robot and a bridge as processes on a real bus: tasks done without a collision, and deaths survived."""

import json
import threading
import time

import psutil
import pytest

pytest.importorskip("pybullet", reason="PyBullet is not installed")
pytest.importorskip("PIL", reason="Pillow is not installed")

from PIL import Image
from typer.testing import CliRunner

from deploy.cli import app
from deploy.profiles import load_deploy_config
from deploy.robot.deployment import Deployment
from deploy.robot.options import RobotOptions
from deploy.robot.trial import Trial
from tests.plans import two_rooms, write_image

# A part of it cannot be seen from the start, so the robot has to drive.
SMALL = "generator:rooms?width=256&height=256&seed=5"
OFFICE = "generator:office?width=192&height=192"
# The bus and robot variants share the seeds of each task, so that both key layouts and all ways to drive are met.
VARIANTS = [("bare", "rmw_zenoh"), ("bare", "ros2dds"), ("cmu", "rmw_zenoh"), ("nav2", "rmw_zenoh")]


def run(tmp_path, task, world, profile, layout, seed, limit, planner="hdplanner", **options):
    trial = Trial(
        task,
        options=RobotOptions(map=world, seed=seed, range_noise=0.02, **options),
        planner=planner,
        profile=profile,
        folder=tmp_path,
        settings=[f"ros.layout={layout}"],
    )
    verdict = trial.run(limit, threading.Event())
    sentence = json.dumps(verdict.to_json())
    print(profile, layout, seed, sentence)
    assert verdict.success, sentence
    assert verdict.collisions == 0, sentence
    return verdict


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_small_world_is_explored(tmp_path):
    verdict = run(tmp_path, "exploration", SMALL, "bare", "rmw_zenoh", 0, 120.0, metres_per_pixel=0.09375)
    assert verdict.distance > 1.0
    assert verdict.seconds < 90.0


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_demo_in_a_floor_plan_crosses_a_door_of_90_cm(tmp_path):
    world = write_image(two_rooms(), tmp_path / "plan.png")
    command = ["demo", "--map", world, "--planner", "nearest", "--folder", str(tmp_path), "--video", "demo.gif"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    assert "the bridge starts: " in result.output
    verdict = json.loads((tmp_path / "verdict.json").read_text("utf-8"))
    # The alcove behind the second room's partition cannot be seen from this side of the door; the closet, behind a gap
    # that the robot does not fit through, is nothing that it owes.
    assert verdict["explored"] >= 0.98
    assert verdict["reason"].startswith("complete")
    assert verdict["collisions"] == 0
    with Image.open(tmp_path / "demo.gif") as video:
        assert video.n_frames > 10


@pytest.mark.slow
@pytest.mark.timeout(1500)
@pytest.mark.parametrize(("profile", "layout", "seed"), [(*each, seed) for seed, each in enumerate(VARIANTS)])
def test_an_office_is_explored(tmp_path, profile, layout, seed):
    run(tmp_path, "exploration", OFFICE, profile, layout, seed, 900.0)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("profile", "layout", "seed"), [(*each, seed) for seed, each in enumerate(VARIANTS)])
def test_the_target_in_an_unknown_office_is_reached(tmp_path, profile, layout, seed):
    verdict = run(tmp_path, "navigation", OFFICE, profile, layout, seed, 600.0)
    assert verdict.to_target <= 1.0


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("layout", ["rmw_zenoh", "ros2dds"])
@pytest.mark.parametrize("with_watchdog", [False, True], ids=["bridge", "bridge-and-watchdog"])
def test_a_killed_bridge_leaves_a_standing_robot(tmp_path, layout, with_watchdog):
    config = load_deploy_config(overrides=[f"ros.layout={layout}"])
    common = ["--set", f"ros.layout={layout}"]
    robot = ["--map", OFFICE]
    with Deployment(config, common, robot, ["--autostart"], tmp_path) as deployment:
        deployment.until(
            lambda: (truth := deployment.truth()) and truth["speed"] > 0.5, 240.0, "the robot does not drive"
        )
        children = psutil.Process(deployment.bridge.pid).children(recursive=True)
        assert children, "the watchdog is a process of its own"
        killed = time.monotonic()
        deployment.bridge.kill()
        if with_watchdog:
            for child in children:
                child.kill()
        began = deployment.truth()["time"]
        deployment.bridge.wait()
        standing = None
        while standing is None and time.monotonic() - killed < 10.0:
            truth = deployment.truth()
            if abs(truth["speed"]) < 0.02 and abs(truth["turn_rate"]) < 0.02:
                standing = truth["time"] - began
            time.sleep(0.01)
        # The time-out of whoever is left to notice, half a second to brake, and two periods of what the test sees.
        allowed = (RobotOptions().command_timeout if with_watchdog else config.safety.bridge_timeout) + 0.5 + 0.2
        print(layout, "with watchdog" if with_watchdog else "bridge alone", standing)
        assert standing is not None
        assert standing <= allowed
        time.sleep(1.0)
        assert abs(deployment.truth()["speed"]) < 0.02, "it stays where it stands"
        assert deployment.truth()["collisions"] == 0
