"""Errors that a user can act on; every message says what was expected, what came and what to do."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Final

_REMEDIES: Final = {
    errno.ENOSPC: "make room on the disk",
    errno.EDQUOT: "make room on the disk",
    errno.EACCES: "check its permissions",
    errno.EPERM: "check its permissions",
    errno.EROFS: "make it writable",
    errno.EMFILE: "raise the limit of open files (ulimit -n)",
    errno.ENFILE: "raise the system's limit of open files",
    errno.EFBIG: "raise the limit on the size of files (ulimit -f)",
}


class HDError(Exception):
    """Base of all errors that a command prints as one line instead of a traceback."""


class LockedError(HDError):
    """Another process works on the same files.

    Attributes:
        holder: number of that process, in words where it is not known.
    """

    def __init__(self, path: Path, holder: str) -> None:
        super().__init__(f"{path} is locked by process {holder}: wait for it, or end it")
        self.holder = holder


class ConfigError(HDError):
    """A configuration value is missing, unknown or out of range."""


class MessageError(HDError):
    """A message from the bus violates the protocol.

    Attributes:
        field: dotted path of the offending field, such as ``chunk.observations.utility``.
    """

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field}: {problem}")
        self.field = field
        self.problem = problem


class RefusedError(HDError):
    """A delivery is refused for good; its actor must not send it again."""


class MapError(HDError):
    """A map file or a map source cannot be used."""


class BusError(HDError):
    """The bus cannot be joined, or a peer answered with an error."""


class CheckpointError(HDError):
    """A checkpoint or a run folder is missing, damaged or belongs to another run."""


class StorageError(CheckpointError):
    """The disk refuses what is written, most often because it is full; nothing of it is kept.

    Attributes:
        needed: bytes that have to find room.
    """

    def __init__(self, problem: str, needed: int = 0) -> None:
        super().__init__(problem)
        self.needed = needed


def refusal(error: OSError) -> str:
    """Return why the system refused to write, and what to do about it."""
    return f"{error.strerror}; {_REMEDIES.get(error.errno or 0, 'check the disk')}"


class SimulatorError(HDError):
    """A simulator cannot start or left its valid state."""


class MappingError(HDError):
    """A scan, a pose or the state of the belief does not allow what was asked of it."""


class WeightsError(HDError):
    """The weights of a policy do not fit its network."""
