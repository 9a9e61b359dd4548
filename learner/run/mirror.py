"""A run's checkpoints at a URL as well, from which a learner on another machine continues.

The journal stays on the learner's own disk: what was acknowledged after the newest checkpoint at the URL is lost with
that disk, and the replay buffer fills anew.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import threading
from collections.abc import Iterable
from pathlib import Path

from common.errors import CheckpointError, HDError
from common.ids import check_id
from common.system.closing import Closing
from common.system.remote_files import RemoteFolder
from learner.run.checkpoints import CheckpointStore
from learner.run.files import make_folder, sync_path
from learner.run.records import new_marker, segment_name

logger = logging.getLogger(__name__)

RETRY_SECONDS = 15.0
LAST_SECONDS = 120.0
"""For which the end of a learner waits for its last checkpoint to arrive."""
_CHECKPOINTS = "checkpoints"
_ALONE = ("run.json", "config.json", "code.json", "summary.json", "episodes.jsonl")
# The manifest says that the others are there.
_PARTS = ("tensors.safetensors", "state.json", "manifest.json")


class Mirror(Closing):
    """Copies the checkpoints of a run to a URL, in a thread of its own: training never waits for the network.

    What cannot be copied is tried again, and said once.

    Args:
        run: folder of the run.
        store: its checkpoints.
        url: of the folder of all runs; the run lies under its name.

    Raises:
        ConfigError: the URL cannot be used.
    """

    def __init__(self, run: Path, store: CheckpointStore, url: str) -> None:
        self._run = run
        self._store = store
        self._remote = RemoteFolder(f"{url.rstrip('/')}/{run.name}")
        self._wanted = threading.Event()
        self._closed = threading.Event()
        self._given_up = threading.Event()
        self._failed = False
        self._thread = threading.Thread(target=self._work, name="mirror of checkpoints", daemon=True)
        self._thread.start()

    def note(self) -> None:
        """Copy what is new; returns at once."""
        self._wanted.set()

    def close(self) -> None:
        """Let the last checkpoint arrive, and stop; safe to call twice."""
        self._closed.set()
        self._wanted.set()
        self._thread.join(LAST_SECONDS)
        if self._thread.is_alive():
            logger.error("%s did not take the last checkpoint within %.0f s", self._remote.url, LAST_SECONDS)
            self._given_up.set()

    def _work(self) -> None:
        while not self._given_up.is_set():
            self._wanted.wait()
            self._wanted.clear()
            # What is pushed may be older than what was written last before the end: only a push after it is the last.
            last = self._closed.is_set()
            if not self._push():
                self._wanted.set()
                (self._given_up if last else self._closed).wait(RETRY_SECONDS)
            elif last:
                return

    def _push(self) -> bool:
        """Copy everything that is not there yet; return whether all of it is there now."""
        try:
            self._copy()
        except FileNotFoundError:
            return False  # pruned meanwhile: there is a newer one
        except HDError as error:
            if not self._failed:
                logger.error("%s; trying again until it works, training continues", error)
            self._failed = True
            return False
        if self._failed:
            logger.info("%s has the checkpoints again", self._remote.url)
        self._failed = False
        return True

    def _copy(self) -> None:
        here = [path.name for path in self._store.folder.iterdir() if path.is_dir() and _is_checkpoint(path.name)]
        for name in _ALONE:
            if (self._run / name).exists():
                self._remote.put(self._run / name, name)
        there = self._remote.names(_CHECKPOINTS)
        for name in here:
            if _PARTS[-1] not in (self._remote.names(f"{_CHECKPOINTS}/{name}") if name in there else ()):
                for part in _PARTS:
                    self._remote.put(self._store.folder / name / part, f"{_CHECKPOINTS}/{name}/{part}")
        for name in there:
            if _is_checkpoint(name) and name not in here:
                self._remote.remove(f"{_CHECKPOINTS}/{name}")


def fetch_run(url: str, root: Path, name: str) -> Path:
    """Bring a run from a URL to this machine, to continue from its newest checkpoint; return its folder.

    Args:
        url: as of `Mirror`.
        root: folder of all runs here.
        name: of the run.

    Raises:
        CheckpointError: there is no such run at the URL, none of its checkpoints is sound, or it is here already.
        RemoteError: the storage cannot be read.
    """
    path = root / check_id(name, "--run")
    if path.exists():
        raise CheckpointError(f"run {name!r} is here already, in {path}: leave --from out, or choose another --runs")
    remote = RemoteFolder(f"{url.rstrip('/')}/{name}")
    temporary = root / f".{name}.{os.getpid()}.tmp"
    shutil.rmtree(temporary, ignore_errors=True)
    make_folder(temporary / _CHECKPOINTS)
    try:
        for alone in _ALONE:
            with contextlib.suppress(FileNotFoundError):
                (temporary / alone).write_bytes(remote.get(alone))
        checkpoints = [each for each in remote.names(_CHECKPOINTS) if _is_checkpoint(each)]
        if not checkpoints or not (temporary / "run.json").exists():
            raise CheckpointError(f"there is no run {name!r} with a checkpoint at {url}")
        for checkpoint in checkpoints:
            (temporary / _CHECKPOINTS / checkpoint).mkdir()
            for part in _PARTS:
                with contextlib.suppress(FileNotFoundError):
                    (temporary / _CHECKPOINTS / checkpoint / part).write_bytes(
                        remote.get(f"{_CHECKPOINTS}/{checkpoint}/{part}")
                    )
        _point(temporary / _CHECKPOINTS, checkpoints)
        newest = CheckpointStore(temporary / _CHECKPOINTS, keep=2).load_newest()
        _begin_journal(temporary / "journal", int(newest.document["ingest"]["segment"]))
        for file in temporary.rglob("*"):
            sync_path(file)
        temporary.rename(path)
        sync_path(root)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    logger.info("fetched run %s from %s: continuing from checkpoint %s", name, url, newest.name)
    return path


def _point(folder: Path, checkpoints: Iterable[str]) -> None:
    """Write the pointers, which are not mirrored: a checkpoint may still be on its way when its pointer has changed."""
    ordered = sorted(checkpoints)
    for which, names in (
        ("last", [name for name in ordered if name.isdigit()]),
        ("best", [name for name in ordered if not name.isdigit()]),
    ):
        if names:
            (folder / which).write_text(names[-1] + "\n", "utf-8")


def _begin_journal(folder: Path, segment: int) -> None:
    """Let the numbers of a new journal continue behind those that the checkpoint covers: each segment counts once."""
    make_folder(folder)
    (folder / segment_name(segment, new_marker())).touch()


def _is_checkpoint(name: str) -> bool:
    return name.isdigit() or name.startswith("policy-")
