"""The page of a training in a real browser, by `make test-page`: a learner, actors that come and die, Chromium.

With ``HD_PAGE_PICTURES=1`` the pictures of the documents are written anew, to docs/pictures.
"""

import os
import re
import signal
import subprocess
import sys

import psutil
import pytest

pytest.importorskip("playwright", reason="Playwright is not installed")

from tests.common.bus.processes import free_port
from tests.rigs.browser import CHROMIUM, PATIENCE, assert_within_reach, chromium, opened, picture
from tests.rigs.learner import until

SETTINGS = [
    'maps.train=["generator:office"]',
    'maps.validation=["generator:office?seed=9"]',
    "maps.validation_count=4",
    "task.max_steps=60",
    "network.width=32",
    "network.heads=2",
    "network.layers=1",
    "replay.min_steps=60",
    "learner.batch_size=8",
    "learner.updates_per_step=0.5",
    "learner.publish_every=50",
    "learner.threads=1",
    "actor.chunk_steps=8",
]
TOKEN = "let-me-command"
BEST = """() => !document.querySelector('[data-figure="Best policy"]').innerText.includes("none")"""

pytestmark = [
    pytest.mark.page,
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed: apt-get install chromium"),
]


class Run:
    """A small training with its page, and actors beside it."""

    def __init__(self, folder):
        self.folder = folder
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.processes = {}
        self.start("learner", "learner", "start", "--run", "office", "--listen", self.endpoint, "--sim", "grid",
                   "--page", "0", *(part for setting in SETTINGS for part in ("--set", setting)))  # fmt: skip
        assert until(lambda: "page: " in self.log("learner"), 3 * PATIENCE), self.log("learner")
        self.address = re.search(r"page: (http://\S+/)", self.log("learner"))[1]

    def start(self, name, *command):
        others = {name: value for name, value in os.environ.items() if not name.startswith("HD_")}
        environment = others | {"HD_PAGE_TOKEN": TOKEN}
        with (self.folder / f"{name}.log").open("w") as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, "-m", *command], stdout=log, stderr=log, env=environment, cwd=self.folder
            )

    def start_actors(self, name, *options):
        self.start(name, "actors", "--connect", self.endpoint, "--run", "office", "--name", name, *options)

    def log(self, name):
        return (self.folder / f"{name}.log").read_text()

    def actor(self, name):
        """Process number of an actor, as its supervisor's children tell."""
        for child in psutil.Process(self.processes[name.rpartition("-")[0]].pid).children():
            if f'"name":"{name}"' in " ".join(child.cmdline()):
                return child.pid
        raise AssertionError(f"{name} does not run")

    def close(self):
        for process in self.processes.values():
            process.terminate()
        for process in self.processes.values():
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    made = Run(tmp_path_factory.mktemp("training"))
    yield made
    made.close()


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


def row(page, name):
    return page.locator(f'tr[data-actor="{name}"]')


def figure(page, name):
    return page.locator(f'.tile[data-figure="{name}"]').inner_text()


def is_painted(page, selector):
    """Wait until a canvas shows more than one colour."""
    page.wait_for_function(
        """(selector) => {
            const canvas = document.querySelector(selector);
            if (!canvas?.width) return false;
            const picture = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            return new Set(new Uint32Array(picture.data.buffer).filter((_, i) => i % 7 === 0)).size > 3;
        }""",
        arg=selector,
    )


def test_the_page_shows_actors_coming_and_dying(run, browser):
    with opened(browser, run.address) as page:
        page.get_by_text("No actor yet").wait_for()
        run.start_actors("desk", "--num", "2")
        for name in ("desk-0", "desk-1"):
            row(page, name).get_by_text("acting").wait_for()
        os.kill(run.actor("desk-1"), signal.SIGKILL)
        row(page, "desk-1").get_by_text("gone").wait_for()
        row(page, "desk-1").get_by_text("was killed by SIGKILL").wait_for()
        row(page, "desk-1").get_by_text("acting").wait_for()
        assert row(page, "desk-1").locator("td").nth(8).inner_text() == "1", "restarts"
        assert row(page, "desk-0").locator("td").nth(8).inner_text() == "0"


def test_an_episode_is_shown_live_and_evaluations_with_their_pictures(run, browser):
    run.start_actors("judge", "--evaluate")
    with opened(browser, run.address, color_scheme="light", viewport={"width": 1440, "height": 1000}) as page:
        page.get_by_role("button", name="Watch desk-0").click()
        is_painted(page, "#map")
        page.locator("#episode dd").first.wait_for()
        before = page.inner_text("#episode")
        page.wait_for_function("(before) => document.getElementById('episode').innerText !== before", arg=before)
        page.wait_for_function("() => document.querySelectorAll('.world').length === 4")
        is_painted(page, ".world canvas")
        page.wait_for_function(BEST)
        page.wait_for_function("() => document.getElementById('no-curves').hidden")
        picture(page, "page-training", full_page=True)
        for name, options in {
            "page-training-dark": {"color_scheme": "dark", "viewport": {"width": 1440, "height": 1000}},
            "page-training-phone": {"viewport": {"width": 390, "height": 844}, "has_touch": True},
        }.items():
            with opened(browser, run.address, **options) as other:
                # On a phone it lies below the curves, and nobody is asked for what is not on the screen.
                other.locator("#live").scroll_into_view_if_needed()
                is_painted(other, "#map")
                other.evaluate("scrollTo(0, 0)")
                assert_within_reach(other)
                picture(other, name)


def test_only_the_token_pauses_and_stops(run, browser):
    # The page ends with its learner.
    with opened(browser, run.address, expected="net::ERR_CONNECTION_REFUSED") as page:
        page.get_by_role("button", name="Pause").click()
        page.get_by_label("Token").fill("let-me-in")
        page.locator("dialog button[type=submit]").click()
        page.get_by_role("alert").get_by_text("this token is wrong").wait_for()
        page.get_by_label("Token").fill(TOKEN)
        page.locator("dialog button[type=submit]").click()
        page.locator("#state", has_text="paused").wait_for()
        page.get_by_role("button", name="Resume").click()
        page.locator("#state", has_not_text="paused").wait_for()
        assert "declared 0.5" in figure(page, "Updates per step") or "wait" in figure(page, "Updates per step")
        page.get_by_role("button", name="Stop…").click()
        page.locator("dialog button[type=submit]").click()
        assert until(lambda: run.processes["learner"].poll() == 0, PATIENCE), run.log("learner")
        page.locator("#state", has_text="Not connected").wait_for()
