import logging

import pytest

from common.system import logs
from common.system.logs import log_file, setup_logging


@pytest.fixture
def root():
    """The root logger, as it was before once the test is over."""
    logger = logging.getLogger()
    handlers, level = logger.handlers[:], logger.level
    yield logger
    logger.handlers[:] = handlers
    logger.setLevel(level)


def test_no_name_reaches_the_terminal_raw(root, capsys):
    setup_logging("info")
    logging.getLogger("x").warning("refused a message of %s", "desk\x1b[2J\x1b]0;owned\x07\r")
    try:
        raise ValueError("\x9b31m")
    except ValueError:
        logging.getLogger("x").exception("two\nlines")
    text = capsys.readouterr().err
    assert not set(text) & set(map(chr, [*range(9), *range(11, 32), 0x7F, *range(0x80, 0xA0)]))
    assert r"desk\x1b[2J\x1b]0;owned\x07\x0d" in text
    assert "two\nlines\nTraceback" in text


def test_log_files_rotate(tmp_path, monkeypatch, root):
    monkeypatch.setattr(logs, "MAX_BYTES", 10_000)
    handler = log_file(tmp_path / "learner.log")
    logger = logging.Logger("x")
    logger.addHandler(handler)
    for number in range(5000):
        logger.warning("line %d\x1b[2J", number)
    handler.close()
    files = sorted(path.name for path in tmp_path.iterdir())
    assert files == ["learner.log", *(f"learner.log.{k}" for k in range(1, logs.KEPT_FILES + 1))]
    assert all(path.stat().st_size <= 10_000 for path in tmp_path.iterdir())
    assert "line 4999" in (tmp_path / "learner.log").read_text()
    assert "\x1b" not in (tmp_path / "learner.log").read_text()
