"""The robots' page in a real browser, by `make test-page`: a simulated robot under physics, a real bridge, Chromium.

With ``HD_PAGE_PICTURES=1`` the pictures of the documents are written anew, to docs/pictures.
"""

import json
import os
import re
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest

pytest.importorskip("playwright", reason="Playwright is not installed")
pytest.importorskip("pybullet", reason="PyBullet is not installed")

from deploy.profiles import load_deploy_config
from deploy.recording.bag_recorder import BagRecorder
from deploy.recording.writer import BagWriter
from deploy.robot.deployment import Deployment
from deploy.ros2 import Node, message
from tests.common.bus.processes import eventually
from tests.common.page.reader import Reader
from tests.rigs.browser import CHROMIUM, PATIENCE, assert_within_reach, chromium, opened, picture

TOKEN = "let-me-command"
# Rooms of the kind that the shipped policy was trained for.
WORLD = "generator:rooms?width=320&height=240"
SETTINGS = ["mapping.resolution=0.25"]
DRIVEN = "[...document.querySelectorAll('#task dt')].find((e) => e.textContent === 'Driven')?.nextSibling.textContent"
BOX = "() => JSON.stringify(document.getElementById('map').getBoundingClientRect())"

pytestmark = [
    pytest.mark.page,
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed: apt-get install chromium"),
]


@pytest.fixture(scope="module")
def deployment(tmp_path_factory):
    folder = tmp_path_factory.mktemp("deployment")
    os.environ["HD_PAGE_TOKEN"] = TOKEN
    try:
        config = load_deploy_config(None, SETTINGS, profile="bare")
        common = [part for setting in SETTINGS for part in ("--set", setting)]
        with Deployment(config, common, ["--map", WORLD, "--seed", "5"], ["--page", "0"], folder) as deployment:

            def address():
                return re.search(r"page: (http://\S+/)", (folder / "bridge.log").read_text())

            deployment.until(address, 300.0, "the page did not come")
            deployment.page = address()[1]
            deployment.until(lambda: (deployment.status() or {}).get("scans", 0) > 3, 300.0, "no map")
            yield deployment
    finally:
        del os.environ["HD_PAGE_TOKEN"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Where the drive to a place that was clicked is recorded."""
    return tmp_path_factory.mktemp("recordings") / "to-the-goal"


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture
def open_page(browser, deployment):
    """Opens the page and fails at the end when anything in it failed, or was asked of elsewhere."""
    with ExitStack() as pages:

        def load(fragment="", **options):
            page = pages.enter_context(opened(browser, deployment.page, fragment, **options))
            page.wait_for_function("() => !/Connecting|Waiting/.test(document.getElementById('state').textContent)")
            return page

        yield load


def says(page, pattern):
    page.wait_for_function(
        "(pattern) => new RegExp(pattern).test(document.getElementById('state').textContent)", arg=pattern
    )


def place_to_go(deployment, reader):
    """Return a place with room around it that the robot knows, 1.5 m away at least, metres."""
    belief = reader.until(lambda: reader.grids.get("robot/robot/belief"))
    x, y, _ = deployment.status()["pose"]
    side, resolution = 100, belief.resolution
    origin = tuple(
        round((at - a) / resolution) * resolution + a - side * resolution / 2.0
        for at, a in zip((x, y), belief.anchor, strict=True)
    )
    free = belief.cells((side, side), origin) == 0
    reach = int(0.7 / resolution)
    roomy = np.ones_like(free)
    for down in range(-reach, reach + 1):
        for across in range(-reach, reach + 1):
            roomy &= np.roll(free, (down, across), (0, 1))
    rows, columns = np.nonzero(roomy)
    places = np.stack([columns, rows], 1) * resolution + np.array(origin) + resolution / 2.0
    away = np.hypot(*(places - (x, y)).T)
    return places[np.argmin(np.abs(away - 2.5))].tolist()


@contextmanager
def recorded(deployment, folder):
    """Record what goes over the robot's topics."""
    stop = threading.Event()
    with (
        BagWriter(folder, config=deployment.config) as bag,
        BagRecorder(deployment.config.ros, bag) as recorder,
    ):
        thread = threading.Thread(target=recorder.run, args=(stop,))
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


@contextmanager
def replaying(folder):
    """The page of a recording, as the command serves it; its address."""
    command = [sys.executable, "-m", "deploy.cli", "page", "0", "--replay", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield re.search(r"page: (http://\S+/)", process.stdout.readline())[1]
        finally:
            process.terminate()


def test_a_wrong_token_is_refused(open_page, deployment):
    page = open_page()
    page.get_by_role("button", name="Emergency stop").click()
    page.get_by_label("Token").fill("let-me-in")
    page.locator("dialog button[type=submit]").click()
    page.get_by_role("alert").get_by_text("this token is wrong").wait_for()
    assert not deployment.status()["emergency_stop"]
    assert eventually(lambda: "wrong token" in deployment.log_tail("bridge"))
    page.keyboard.press("Escape")
    page.locator("dialog").wait_for(state="detached")
    assert not deployment.status()["emergency_stop"], "Escape closed the dialog, and no more"


def test_a_click_on_the_map_makes_the_robot_arrive_there(open_page, deployment, recording):
    page = open_page(f"#token={TOKEN}")
    assert "token" not in page.url
    with Reader(deployment.page) as reader:
        x, y = place_to_go(deployment, reader)
    page.wait_for_function("() => document.documentElement.hasAttribute('data-commands')")
    page.get_by_role("button", name="Show everything").click()
    page.wait_for_timeout(500)
    box = json.loads(page.evaluate(BOX))
    at = page.evaluate("([x, y]) => document.getElementById('map').toScreen(x, y)", [x, y])
    page.mouse.click(box["x"] + at[0], box["y"] + at[1])

    def arrived():
        truth = deployment.truth()
        return np.hypot(truth["x"] - x, truth["y"] - y) < 1.0

    with recorded(deployment, recording):
        page.get_by_role("button", name="Go here").click()
        deployment.until(lambda: deployment.status()["target"] is not None, PATIENCE, "no target")
        assert deployment.status()["target"] == pytest.approx([x, y], abs=0.15)
        deployment.until(arrived, 3 * PATIENCE, f"the robot does not come to {x:.1f}, {y:.1f}")
    deployment.until(lambda: deployment.status()["state"] != "running", PATIENCE, "it does not notice")


def test_a_recording_is_replayed_on_the_same_page(browser, recording):
    with replaying(recording) as address, opened(browser, address, f"#token={TOKEN}", color_scheme="light") as page:
        place = page.get_by_role("slider", name="Place in the recording")
        page.wait_for_function("() => document.documentElement.hasAttribute('data-commands')")
        page.locator("#replay-play").wait_for()
        place.focus()
        page.keyboard.press("End")
        page.get_by_role("button", name="Play the recording").wait_for()
        says(page, "Running|Holding|Finished")
        page.wait_for_function(f"() => /[1-9]/.test({DRIVEN})")
        end = page.evaluate(DRIVEN)
        assert not page.get_by_role("button", name="Emergency stop").is_visible()
        assert not page.locator("#commands").is_visible()
        assert_within_reach(page)
        place.focus()
        page.keyboard.press("Home")
        page.wait_for_function(f"(end) => {DRIVEN} !== end", arg=end)
        page.get_by_role("button", name="Play the recording").click()
        page.get_by_role("button", name="Pause the recording").wait_for()
        # There is nobody to be stopped.
        page.keyboard.press("Space")
        assert page.locator("dialog").count() == 0


def test_the_space_bar_stops_and_only_a_release_lets_go(open_page, deployment):
    page = open_page(f"#token={TOKEN}")
    page.wait_for_function("() => document.documentElement.hasAttribute('data-commands')")
    page.locator("#buttons button", has_text=re.compile("Start|Continue exploring")).first.click()
    says(page, "Running|Holding")
    deployment.until(lambda: deployment.truth()["speed"] > 0.1, 2 * PATIENCE, "it does not move")
    # Whatever has the focus.
    page.get_by_role("button", name="Goal").focus()
    page.keyboard.press("Space")
    says(page, "Stopped")
    assert page.locator("dialog").count() == 0
    deployment.until(lambda: deployment.truth()["speed"] < 0.02, PATIENCE, "it still moves")
    assert page.locator("#buttons button.main").is_disabled()
    picture(page, "page-robots-stopped")
    page.get_by_role("button", name="Release…").click()
    page.get_by_label("Who").fill("anna")
    page.get_by_label("Why it is safe").fill("the hall is empty")
    page.locator("dialog button[type=submit]").click()
    page.wait_for_function("() => document.getElementById('state').textContent !== 'Stopped'")
    deployment.until(lambda: "released by anna" in deployment.log_tail("bridge"), PATIENCE, "it is not in the log")


def test_an_exploration_is_driven_from_the_page_alone(open_page, deployment):
    page = open_page(f"#token={TOKEN}", color_scheme="light")
    page.wait_for_function("() => document.documentElement.hasAttribute('data-commands')")
    page.locator("#buttons button", has_text=re.compile("Start|Continue exploring")).first.click()
    says(page, "Running|Holding|Finished")
    began = deployment.status()["distance"]
    deployment.until(lambda: deployment.status()["distance"] > began + 5.0, 3 * PATIENCE, "it does not explore")
    page.get_by_role("button", name="Show everything").click()
    assert_within_reach(page)
    picture(page, "page-robots")
    dark = open_page(color_scheme="dark")
    picture(dark, "page-robots-dark")
    phone = open_page(viewport={"width": 390, "height": 800}, has_touch=True, color_scheme="light")
    stop = phone.get_by_role("button", name="Emergency stop").bounding_box()
    assert stop["y"] + stop["height"] <= 800
    assert stop["height"] >= 90
    assert_within_reach(phone)
    phone.mouse.wheel(0, 900)
    assert phone.get_by_role("button", name="Emergency stop").bounding_box()["y"] == stop["y"]
    phone.mouse.wheel(0, -900)
    picture(phone, "page-robots-phone")
    page.wait_for_function("() => document.getElementById('state').textContent === 'Finished'", timeout=900e3)
    assert "complete" in page.inner_text("#reason")
    with Reader(deployment.page) as reader:
        events = reader.until(lambda: reader.series.get("robot/robot/events"))[0]
        session = {"events": events, "status": deployment.status(), "truth": deployment.truth()}
    (deployment._folder / "session.json").write_text(json.dumps(session, indent=1))
    print((deployment._folder / "bridge.log").read_text())
    print(json.dumps(session["truth"]))


def test_several_robots_share_a_page_and_its_stop(open_page, deployment):
    page = open_page()
    ros = deployment.config.ros.model_copy(update={"namespace": "second"})
    told = {"name": "second", "state": "paused", "reason": "waits at the gate", "pose": [1.0, 2.0, 0.5]}
    with Node(ros, "another_bridge") as node:
        status = node.publisher("hd/status", "std_msgs/msg/String")

        def shows():
            status.publish(message("std_msgs/msg/String", data=json.dumps(told)))
            return page.get_by_role("tab").count() == 2

        deployment.until(shows, PATIENCE, "the second robot is not shown")
        page.get_by_role("button", name="Emergency stop of all robots").wait_for()
        page.get_by_role("tab", name="second").click()
        says(page, "Paused|No signal")
        page.get_by_role("button", name="Stop this robot").wait_for()
        assert_within_reach(page)
    says(page, "No signal")
    page.get_by_role("tab", name="robot").first.click()
    says(page, "^(?!No signal)")
