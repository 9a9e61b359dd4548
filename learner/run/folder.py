"""The folder of a run: everything that is needed to understand, continue and use it."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import shutil
import time
from pathlib import Path

from common.config import RunConfig
from common.config.load import resolve
from common.errors import CheckpointError, ConfigError, LockedError, StorageError
from common.system.closing import Closing
from common.system.documents import read_json
from common.system.file_lock import FileLock
from learner.run.changes import check_change
from learner.run.code_state import write_code_state
from learner.run.files import make_folder, remove_leftovers, replace_text, sync_path, to_json

logger = logging.getLogger(__name__)

# 2: viewpoints lie anywhere and edges are lists. 3: steps carry probabilities, labels the way that remains.
# 4: records of the journal can be found again behind damage.
FORMAT = 4
OLDEST_CONTINUED = 3
"""Of runs of an earlier format the policies can be exported, but the experience cannot be read any more."""
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
    `summary.json`            see `RunSummary`
    `tracking.json`           names of the run in trackers, see `make_writers`
    `checkpoints/`            see `CheckpointStore`
    `journal/`                see `Journal`
    `damaged/`                bytes that could not be read any more
    ========================  ===================================================================

    Make one with `create` or `open`; `close` (or leaving a `with` block) gives the lock back.
    """

    def __init__(self, path: Path, config: RunConfig, lock: FileLock) -> None:
        self.path = path
        self.config = config
        self._written = config
        self._lock = lock

    @classmethod
    def create(cls, root: Path, config: RunConfig, *, overwrite: bool = False) -> RunFolder:
        """Make the folder of a new run, or take one again whose first start came to no checkpoint.

        Args:
            root: folder of all runs.
            config: the resolved configuration.
            overwrite: delete a run of the same name.

        Raises:
            CheckpointError: when the folder exists and may not be overwritten, or a learner works on it.
            StorageError: when the disk refuses it; nothing is left of it then.
        """
        path = root / config.name
        if path.exists() and not overwrite and not has_begun(path):
            logger.info("run %s has no checkpoint: starting over, with the content of its journal", config.name)
            run = cls.open(root, config.name)
            run.reconfigure(config)
            run.write_config()
            return run
        if path.exists():
            if not overwrite:
                raise CheckpointError(
                    f"run {config.name!r} exists already in {path}: continue it with `hd-learner resume --run "
                    f"{config.name}`, choose another --run, or delete it with --overwrite"
                )
            _delete_run(path)
        return cls._make(root, config)

    @classmethod
    def _make(cls, root: Path, config: RunConfig) -> RunFolder:
        path = root / config.name
        temporary = root / f".{config.name}.{os.getpid()}.tmp"
        lock = None
        try:
            make_folder(root)
            _clear_unfinished(root, config.name)
            temporary.mkdir()
            write_code_state(temporary, "code")
            (temporary / "config.json").write_text(_config_text(config), "utf-8")
            marker = {"format": FORMAT, "created": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
            (temporary / _MARKER).write_text(to_json(marker), "utf-8")
            for file in temporary.iterdir():
                sync_path(file)
            lock = lock_run(temporary)
            sync_path(temporary)
            if not _take_name(temporary, path):
                raise CheckpointError(f"another learner has just started run {config.name!r}: choose another --run")
            sync_path(root)
        except (OSError, CheckpointError) as error:
            if lock is not None:
                lock.close()
            shutil.rmtree(temporary, ignore_errors=True)
            if isinstance(error, CheckpointError):
                raise
            raise _cannot_write(path, error) from error
        return cls(path, config, lock)

    @classmethod
    def open(cls, root: Path, name: str) -> RunFolder:
        """Open an existing run in order to continue it.

        Raises:
            CheckpointError: when there is no such run, an earlier release began it, its configuration is damaged, or a
                learner works on it.
            StorageError: when the disk refuses what has to be written for that.
        """
        path = root / name
        written = check_run(path, to_continue=True)
        config = read_config(path)
        try:
            lock = lock_run(path)
            remove_leftovers(path)
            if written < FORMAT:
                # From here on the journal has records that earlier releases cannot read.
                marker = read_json(path / _MARKER)
                replace_text(path / _MARKER, to_json({**marker, "format": FORMAT}))
        except OSError as error:
            raise _cannot_write(path, error) from error
        return cls(path, config, lock)

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
        """Continue the run with another configuration; its file changes with `write_config` alone.

        Raises:
            ConfigError: what the run has learnt and stored would mean something else then.
        """
        if has_begun(self.path):
            check_change(self._written, config)
        self.config = config

    def write_config(self) -> None:
        """Write the configuration that the run continues with; the one before is kept as `config.<number>.json`.

        Called once the run does continue with it: one that cannot be continued with must not take the place of the
        one that it can.
        """
        if self.config == self._written:
            return
        number = 1 + len(list(self.path.glob("config.*.json")))
        try:
            replace_text(self.path / f"config.{number}.json", _config_text(self._written))
            replace_text(self.path / "config.json", _config_text(self.config))
        except OSError as error:
            raise _cannot_write(self.path, error) from error
        self._written = self.config

    def note_code(self, update: int) -> None:
        """Write the state of the code that continues the run from ``update`` on."""
        try:
            write_code_state(self.path, f"code.from-{update:09d}")
        except OSError as error:
            raise _cannot_write(self.path, error) from error

    def close(self) -> None:
        """Give the lock back; safe to call twice."""
        self._lock.close()


def has_begun(path: Path) -> bool:
    """Whether the run in ``path`` has ever had a checkpoint; without one, a start or a resume begins it again.

    True as well for a folder that is no run, which nothing may be written into.
    """
    if not (path / _MARKER).is_file():
        return True
    checkpoints = path / "checkpoints"
    return any(checkpoints.glob("[0-9]*")) or any(checkpoints.glob("damaged-*"))


def check_run(path: Path, *, to_continue: bool = False) -> int:
    """Raise CheckpointError unless ``path`` is the folder of a run that this software can read; return its format.

    Args:
        path: folder of the run.
        to_continue: its experience must be readable too, not its policies alone.
    """
    if not (path / _MARKER).is_file():
        known = sorted(entry.parent.name for entry in path.parent.glob(f"[!.]*/{_MARKER}"))
        listed = f"there are: {', '.join(known)}" if known else "there are none yet; `hd-learner start` creates one"
        raise CheckpointError(f"there is no run {path.name!r} in {path.parent}: {listed}")
    try:
        written = read_json(path / _MARKER)["format"]
    except (ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"{path / _MARKER} is damaged: {error!r}") from error
    if written not in range(1, FORMAT + 1):
        raise CheckpointError(
            f"run {path} has format {written!r}, this software reads format {FORMAT} and earlier ones"
        )
    if to_continue and written < OLDEST_CONTINUED:
        raise CheckpointError(
            f"run {path} has format {written}, and this software cannot read experience from before format "
            f"{OLDEST_CONTINUED}: "
            f"resume it with the release that started it, or export its policy (`hd-learner export --run {path.name}`) "
            "and begin a new run from that (`hd-learner start --run NEW --set learner.initial_policy=FILE`)"
        )
    return int(written)


def read_config(path: Path) -> RunConfig:
    """Read the resolved configuration of the run in ``path``."""
    try:
        return resolve(read_json(path / "config.json"))
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{path / 'config.json'} cannot be read: {error}") from error
    except ConfigError as error:
        raise CheckpointError(
            f"{path / 'config.json'} does not suit this release: {' '.join(str(error).split())}: use the release that "
            "wrote it, or correct it"
        ) from None


def _config_text(config: RunConfig) -> str:
    return config.model_dump_json(indent=2) + "\n"


def _cannot_write(path: Path, error: OSError) -> StorageError:
    return StorageError(f"cannot write the run's folder {path}: {error.strerror}; make room, or choose another --runs")


def _take_name(temporary: Path, path: Path) -> bool:
    """Give a folder its final name; return False when another has it."""
    try:
        temporary.rename(path)
    except OSError as error:
        if error.errno in (errno.EEXIST, errno.ENOTEMPTY):
            return False
        raise
    return True


def _clear_unfinished(root: Path, name: str) -> None:
    """Delete the folders that killed processes of this machine left while they made or deleted the run."""
    for leftover in root.glob(f".{name}.*.tmp"):
        owner = leftover.name.removeprefix(f".{name}.").split(".")[0]
        if owner.isdigit() and not _is_running(int(owner)):
            shutil.rmtree(leftover, ignore_errors=True)


def _is_running(process: int) -> bool:
    if process == os.getpid():
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def lock_run(path: Path, *, read_only: bool = False) -> FileLock:
    """Take the lock of the run in ``path``; raise CheckpointError when a learner works on it."""
    try:
        return FileLock(path / "lock", read_only=read_only)
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
    with lock_run(path), contextlib.suppress(FileNotFoundError):
        path.rename(doomed)
        shutil.rmtree(doomed)
