import json
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from learner.run import episodes as module
from learner.run.episodes import EpisodeLog, read_episodes
from learner.run.files import DAMAGED
from tests.learner.experience import episode_report


def write(path, count, start=0):
    log = EpisodeLog(path)
    for number in range(start, start + count):
        log.append(episode_report(distance=float(number)), time=1.0 + number, actor="desk-0", updates=number)
    log.close()
    return log.length


def distances(path):
    return [report.distance for _, report in read_episodes(path)]


@settings(max_examples=60, deadline=None)
@given(start=st.integers(0, 3500), length=st.integers(1, 700))
def test_damage_costs_the_lines_that_it_touches(tmp_path_factory, start, length):
    path = tmp_path_factory.mktemp("run") / "episodes.jsonl"
    before = write(path, 10)
    content = path.read_bytes()
    start = min(start, before - 1)
    end = min(start + length, before)
    path.write_bytes(content[:start] + bytes(end - start) + content[end:])
    places = [0]
    for line in content.splitlines(keepends=True):
        places.append(places[-1] + len(line))
    sound = [float(i) for i in range(10) if places[i + 1] <= start or end <= places[i]]
    # A line feed that is lost takes the line behind it along.
    if end in places[1:-1]:
        sound = [number for number in sound if number != float(places.index(end))]
    log = EpisodeLog(path, before)
    assert log.length == before, "the lengths in older checkpoints must stay right"
    log.append(episode_report(distance=10.0), time=20.0, actor="desk-0", updates=1)
    log.close()
    assert distances(path) == [*sound, 10.0]
    assert log.means("train").count == len(sound) + 1
    assert list((path.parent / DAMAGED).iterdir())


def test_a_short_write_spoils_no_later_line(tmp_path, monkeypatch):
    path = tmp_path / "episodes.jsonl"
    log = EpisodeLog(path)
    real = os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: real(descriptor, bytes(data)[:7]))
    log.append(episode_report(distance=1.0), time=1.0, actor="a", updates=0)
    monkeypatch.setattr(os, "write", failing_after(real, 9))
    log.append(episode_report(distance=2.0), time=1.0, actor="a", updates=0)
    assert distances(path) == [1.0]
    with pytest.raises(module.StorageError, match="make room"):
        log.flush()
    monkeypatch.undo()
    log.append(episode_report(distance=3.0), time=1.0, actor="a", updates=0)
    assert distances(path) == [1.0, 2.0, 3.0]
    assert log.length == path.stat().st_size
    log.close()


def failing_after(real, size):
    def write(descriptor, data):
        real(descriptor, bytes(data)[:size])
        raise OSError(28, "No space left on device")

    return write


@pytest.mark.parametrize(
    "line", ["{}", "[1]", '{"distance": 1e999}', "\x00" * 40, '{"time": 1, "actor": "a", "updates": 0}']
)
def test_lines_that_are_no_reports_are_set_aside(tmp_path, line, caplog):
    path = tmp_path / "episodes.jsonl"
    write(path, 2)
    with path.open("a") as file:
        file.write(line + "\n")
    write(path, 1, start=2)
    assert distances(path) == [0.0, 1.0, 2.0]
    assert "1 damaged lines are lost" in caplog.text
    (kept,) = (tmp_path / DAMAGED).iterdir()
    assert kept.read_text() == line + "\n"


def test_lines_of_releases_without_families_are_read(tmp_path):
    path = tmp_path / "episodes.jsonl"
    write(path, 1)
    values = json.loads(path.read_text())
    del values["family"], values["classical_distance"]
    path.write_text(json.dumps(values) + "\n")
    assert distances(path) == [0.0]


def test_a_file_that_lost_its_end_is_told(tmp_path, caplog):
    path = tmp_path / "episodes.jsonl"
    length = write(path, 5)
    os.truncate(path, length - 400)
    EpisodeLog(path, length).close()
    assert "400 bytes at the end are missing" in caplog.text
    assert len(distances(path)) >= 3
