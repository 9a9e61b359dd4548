"""A page as a process, and clients over real sockets."""

import os
import signal
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from common.errors import ConfigError
from common.page.hub import PageError
from common.page.options import PageSettings, page_settings
from common.page.process import PageProcess
from tests.common.bus.processes import eventually
from tests.common.page.reader import Reader

websockets = pytest.importorskip("websockets", reason="the extra `page` is not installed")
TOKEN = "let-me-command"
MODULE = "tests.common.page.clock"


@pytest.fixture(scope="module", autouse=True)
def _importable():
    """Let the page's process, which does not look into the working folder, find the clock."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[3]), prepend=os.pathsep)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    (folder / "index.html").write_text("<!doctype html><title>clock</title>")
    (folder / "clock.js").write_text("export {}")
    return folder


@pytest.fixture(scope="module")
def page(folder):
    settings = PageSettings(0, token=TOKEN, rate=20.0, clients=12)
    with PageProcess(MODULE, settings, {"folder": str(folder)}) as page:
        yield page


def fetch(address, **headers):
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=10) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


def test_files_come_with_a_strict_policy_and_nothing_from_elsewhere(page):
    for path, kind in (
        ("", "text/html"),
        ("clock.js", "text/javascript"),
        ("core/theme.css", "text/css"),
        ("core/palette.css", "text/css"),
        ("core/vendor/uPlot.esm.js", "text/javascript"),
    ):
        status, headers, body = fetch(page.address + path)
        assert status == 200, path
        assert headers["Content-Type"].startswith(kind)
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "unsafe" not in headers["Content-Security-Policy"]
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert fetch(page.address + path, **{"If-None-Match": headers["ETag"]})[0] == 304
        assert body
    for path in ("../pyproject.toml", "core/../app.py", "nothing.js", "%2e%2e/app.py"):
        assert fetch(page.address + path)[0] == 404


def test_a_reader_sees_and_may_not_command(page):
    with Reader(page.address) as reader:
        assert reader.hello["page"] == "clock"
        assert not reader.welcome["may_command"]
        reader.until(lambda: reader.grids.get("clock/grid") and len(reader.series["clock/series"][0]) > 3)
        ticks = reader.series["clock/series"][0]
        assert ticks == list(range(ticks[0], ticks[-1] + 1)), "each item once, in order"
        answer = reader.command("refuse")
        assert (answer["ok"], answer["error"]) == (False, "commands need the token")


def test_a_client_hears_what_is_gone_and_that_the_page_lives(page):
    with Reader(page.address, token=TOKEN) as reader:
        reader.until(lambda: "clock/grid" in reader.grids and "clock/series" in reader.series)
        before = reader.until(lambda: reader.values.get("page/time"))
        assert reader.command("drop")["ok"]
        reader.until(lambda: {"clock/ticks", "clock/series", "clock/grid"} <= set(reader.gone))
        # They come again as new ones.
        reader.until(lambda: "clock/series" in reader.series and "clock/grid" in reader.grids)
        items, following = reader.series["clock/series"]
        assert following == len(items)
        reader.until(lambda: reader.values["page/time"] > before)


def test_a_wrong_token_is_refused_and_logged(folder, capfd):
    with PageProcess(MODULE, PageSettings(0, token=TOKEN), {"folder": str(folder)}) as page:
        with Reader(page.address, token="let-me-in") as reader:
            assert reader.welcome == {"type": "welcome", "may_command": False, "why": "this token is wrong"}
            assert not reader.command("stop")["ok"]
        log = ""

        def logged():
            nonlocal log
            log += capfd.readouterr().err
            return "wrong token" in log

        assert eventually(logged)
        assert "127.0.0.1:" in log
        assert "let-me-in" not in log


def test_commands_are_answered_and_a_stop_waits_for_nobody(page):
    with Reader(page.address, token=TOKEN) as reader:
        assert reader.welcome["may_command"]
        for number in range(100, 110):
            reader.send(type="command", id=number, target="a", verb="wait")
        assert reader.command("stop", "a")["state"] == {"verb": "stop", "target": "a"}
        found = [reader.until(lambda n=number: reader.answers.get(n)) for number in range(100, 110)]
        assert [answer["ok"] for answer in found].count(True) == 8, "the others were too many at a time"
        assert "wait for" in found[-1]["error"]
        assert reader.command("refuse", why="so")["error"] == "not {'why': 'so'}"
        assert "RuntimeError: broken" in reader.command("break")["error"]
        assert "must be one of" in reader.command("dance")["error"]


def test_other_web_sites_get_nothing(page):
    host = page.address.removeprefix("http://").rstrip("/")
    Reader(page.address, origin=f"http://{host}").close()
    for origin in ("http://evil.example", f"http://evil.example/{host}", "null"):
        with pytest.raises(websockets.exceptions.InvalidStatus) as refused:
            Reader(page.address, origin=origin)
        assert refused.value.response.status_code == 403
    # A name that was made to point here (DNS rebinding).
    assert fetch(page.address, Host="evil.example")[0] == 421
    assert fetch(page.address, Host="localhost:1")[0] == 200


def test_nonsense_ends_a_connection_and_only_that(page):
    with Reader(page.address) as good:
        with Reader(page.address) as bad:
            bad.socket.send("nonsense")
            code, said = bad.closed()
            assert (code, said["type"]) == (1002, "error")
            assert "must be a JSON object" in said["error"]
        with Reader(page.address) as bad:
            bad.send(type="hello", protocol=2)
            assert "load the page anew" in bad.closed()[1]["error"]
        with Reader(page.address) as bad:
            bad.socket.send("x" * (1 << 20))
            assert bad.closed()[0] == 1009
        before = good.until(lambda: good.values.get("clock/ticks"))
        good.until(lambda: good.values["clock/ticks"]["ticks"] > before["ticks"])


def test_more_browsers_than_allowed_are_turned_away(page):
    readers = [Reader(page.address) for _ in range(12)]
    try:
        with websockets.sync.client.connect(page.address.replace("http", "ws") + "ws") as late:
            with pytest.raises(websockets.exceptions.ConnectionClosed) as turned_away:
                late.recv(10)
            assert turned_away.value.rcvd.code == 1013
    finally:
        for reader in readers:
            reader.close()


def test_a_source_knows_what_is_watched(page):
    with Reader(page.address, channels=["clock/ticks"]) as reader:
        reader.until(lambda: reader.values.get("clock/ticks", {}).get("watched") is False)
        reader.watch("clock/ticks", "clock/dear")
        reader.until(lambda: reader.values["clock/ticks"]["watched"])


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
def test_a_browser_that_takes_nothing_costs_no_memory(folder):
    """400 KB twenty times a second go to nobody: kernel buffers and a frame are all that may be held."""
    settings = PageSettings(0, rate=20.0)
    with (
        PageProcess(MODULE, settings, {"folder": str(folder), "wide": 100_000}) as page,
        Reader(page.address, channels=["clock/*"]) as quick,
        Reader(page.address, channels=["clock/*"]),
    ):

        def ticks():
            return quick.values.get("clock/ticks", {}).get("ticks", 0)

        quick.until(lambda: ticks() > 5)
        before = memory(page.pid)
        start = ticks()
        quick.until(lambda: ticks() > start + 30)
        assert memory(page.pid) - before < 6 << 20


def memory(pid):
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_a_page_that_dies_comes_again_at_its_address(folder, monkeypatch):
    monkeypatch.setattr("common.page.process._AGAIN_SECONDS", 0.05)
    with PageProcess(MODULE, PageSettings(0), {"folder": str(folder)}) as page:
        address, first = page.address, page.pid
        os.kill(first, signal.SIGKILL)
        assert eventually(lambda: page.pid != first and fetch(address)[0] == 200)
    with pytest.raises(urllib.error.URLError):
        fetch(address)


def test_an_address_that_is_taken_is_said_at_the_start(folder, page):
    port = int(page.address.rstrip("/").rsplit(":", 1)[1])
    began = time.monotonic()
    with pytest.raises(PageError, match=f"cannot be served at 127.0.0.1:{port}"):
        PageProcess(MODULE, PageSettings(port), {"folder": str(folder)})
    assert time.monotonic() - began < 20


def test_where_and_who_is_read_from_the_command_line_and_the_environment(tmp_path, monkeypatch):
    monkeypatch.delenv("HD_PAGE_TOKEN", raising=False)
    made = page_settings("8080")
    assert (made.host, made.port, made.made_token) == ("127.0.0.1", 8080, True)
    assert len(made.token) >= 16
    assert made.token != page_settings("8080").token
    assert made.token not in repr(made)
    assert page_settings("[::1]:80").host == "::1"
    monkeypatch.setenv("HD_PAGE_TOKEN", "from-environment")
    assert page_settings("robot.local:1").token == "from-environment"
    (tmp_path / "token").write_text("from-the-file\n")
    assert page_settings("1", tmp_path / "token").token == "from-the-file"
    for address in ("", "http://x:1", "8080:x", "99999", "a b:1"):
        with pytest.raises(ConfigError, match="--page"):
            page_settings(address)
    (tmp_path / "token").write_text("short")
    with pytest.raises(ConfigError, match="8 to 200"):
        page_settings("1", tmp_path / "token")
    with pytest.raises(ConfigError, match="cannot read"):
        page_settings("1", tmp_path / "nothing")
