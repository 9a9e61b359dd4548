"""The folder of a run: everything that is needed to understand, continue and use it."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import time
from pathlib import Path

from common.closing import Closing
from common.config.load import resolve
from common.config.schema import RunConfig
from common.errors import CheckpointError, LockedError
from common.file_lock import FileLock
from learner.run.code_state import write_code_state
from learner.run.files import replace_text, sync_path, to_json

# Of runs of an earlier format the policies can be exported, but the experience cannot be read any more.
# 2: viewpoints lie anywhere and edges are lists. 3: steps carry probabilities, labels the way that remains.
FORMAT = 3
_MARKER = "run.json"


class RunFolder(Closing):
    """`<root>/<name>/`, held by one learner at a time.

    ========================  ===================================================================
    `run.json`                format and time of creation; marks the folder as a run
    `config.json`             the resolved configuration
    `code.json`, `code.diff`  commit, status and differences of the code, package versions, command
    `learner.log`             what the learner said
    `episodes.jsonl`          one line per finished episode
    `tensorboard/`            curves
    `checkpoints/`            see `CheckpointStore`
    `journal/`                see `Journal`
    ========================  ===================================================================

    Make one with `create` or `open`; `close` (or leaving a `with` block) gives the lock back.
    """

    def __init__(self, path: Path, config: RunConfig, lock: FileLock) -> None:
        self.path = path
        self.config = config
        self._lock = lock

    @classmethod
    def create(cls, root: Path, config: RunConfig, *, overwrite: bool = False) -> RunFolder:
        """Make the folder of a new run.

        Args:
            root: folder of all runs.
            config: the resolved configuration.
            overwrite: delete a run of the same name.

        Raises:
            CheckpointError: when the folder exists and may not be overwritten, or a learner works on it.
        """
        path = root / config.name
        if path.exists():
            if not overwrite:
                raise CheckpointError(
                    f"run {config.name!r} exists already in {path}: continue it with `hd-learner resume --run "
                    f"{config.name}`, choose another --run, or delete it with --overwrite"
                )
            _delete_run(path)
        temporary = root / f".{config.name}.{os.getpid()}.tmp"
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        write_code_state(temporary, "code")
        (temporary / "config.json").write_text(config.model_dump_json(indent=2) + "\n", "utf-8")
        marker = {"format": FORMAT, "created": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
        (temporary / _MARKER).write_text(to_json(marker), "utf-8")
        lock = _take_lock(temporary)
        try:
            temporary.rename(path)
        except OSError:
            lock.close()
            shutil.rmtree(temporary, ignore_errors=True)
            raise CheckpointError(
                f"another learner has just started run {config.name!r}: choose another --run"
            ) from None
        sync_path(root)
        return cls(path, config, lock)

    @classmethod
    def open(cls, root: Path, name: str) -> RunFolder:
        """Open an existing run in order to continue it.

        Raises:
            CheckpointError: when there is no such run, an earlier release began it, its configuration is damaged, or a
                learner works on it.
        """
        path = root / name
        check_run(path, to_continue=True)
        return cls(path, read_config(path), _take_lock(path))

    @property
    def checkpoints(self) -> Path:
        """Folder of the checkpoints."""
        return self.path / "checkpoints"

    @property
    def journal(self) -> Path:
        """Folder of the journal."""
        return self.path / "journal"

    @property
    def tensorboard(self) -> Path:
        """Folder of the TensorBoard events."""
        return self.path / "tensorboard"

    @property
    def episodes(self) -> Path:
        """File of the finished episodes."""
        return self.path / "episodes.jsonl"

    def reconfigure(self, config: RunConfig) -> None:
        """Replace the configuration of a resumed run; the one before is kept as `config.<number>.json`."""
        if config == self.config:
            return
        number = 1 + len(list(self.path.glob("config.*.json")))
        replace_text(self.path / f"config.{number}.json", self.config.model_dump_json(indent=2) + "\n")
        replace_text(self.path / "config.json", config.model_dump_json(indent=2) + "\n")
        self.config = config

    def note_code(self, update: int) -> None:
        """Write the state of the code that continues the run from ``update`` on."""
        write_code_state(self.path, f"code.from-{update:09d}")

    def close(self) -> None:
        """Give the lock back; safe to call twice."""
        self._lock.close()


def check_run(path: Path, *, to_continue: bool = False) -> None:
    """Raise CheckpointError unless ``path`` is the folder of a run that this software can read.

    Args:
        path: folder of the run.
        to_continue: its experience must be readable too, not its policies alone.
    """
    if not (path / _MARKER).is_file():
        known = sorted(entry.parent.name for entry in path.parent.glob(f"[!.]*/{_MARKER}"))
        listed = f"there are: {', '.join(known)}" if known else "there is none yet; `hd-learner start` makes one"
        raise CheckpointError(f"there is no run {path.name!r} in {path.parent}: {listed}")
    try:
        written = json.loads((path / _MARKER).read_text("utf-8"))["format"]
    except (ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"{path / _MARKER} is damaged: {error!r}") from error
    if written not in range(1, FORMAT + 1):
        raise CheckpointError(f"run {path} has format {written}, this software reads format {FORMAT} and earlier ones")
    if to_continue and written < FORMAT:
        raise CheckpointError(
            f"run {path} has format {written}, and this software cannot read experience from before format {FORMAT}: "
            f"resume it with the release that began it, or export its policy (`hd-learner export --run {path.name}`) "
            "and begin a new run from that (`hd-learner start --run NEW --set learner.initial_policy=FILE`)"
        )


def read_config(path: Path) -> RunConfig:
    """Read the resolved configuration of the run in ``path``."""
    try:
        return resolve(json.loads((path / "config.json").read_text("utf-8")))
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{path / 'config.json'} cannot be read: {error}") from error


def _take_lock(path: Path) -> FileLock:
    try:
        return FileLock(path / "lock")
    except LockedError as error:
        raise CheckpointError(
            f"a learner (process {error.holder}) works on the run in {path}: "
            f"stop it first with `hd-learner stop --run {path.name}`"
        ) from None


def _delete_run(path: Path) -> None:
    """Delete a run that no learner works on; refuse anything that is not a run."""
    if not (path / _MARKER).is_file():
        raise CheckpointError(
            f"{path} is not the folder of a run, so it stays: choose another --run or remove it yourself"
        )
    doomed = path.with_name(f".{path.name}.{os.getpid()}.old.tmp")
    with _take_lock(path), contextlib.suppress(FileNotFoundError):
        path.rename(doomed)
        shutil.rmtree(doomed)
