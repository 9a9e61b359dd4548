"""Checkpoints: folders of safetensors and JSON that are whole or absent, with digests that betray damage."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import shutil
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from common.errors import CheckpointError, StorageError, refusal
from common.system.documents import read_json
from learner.run.files import file_digest, make_folder, replace_text, sync_path, to_json

logger = logging.getLogger(__name__)

FORMAT = 1
EXPORT_PREFIX = "export."
"""Tensors of a checkpoint under this prefix are the policy for robots and evaluation; resuming needs them not."""
_MANIFEST = "manifest.json"
_DOCUMENT = "state.json"
_TENSORS = "tensors.safetensors"
_REPLACED = ".replaced.tmp"


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """What a checkpoint holds.

    Attributes:
        name: name of its folder.
        tensors: named tensors on the CPU.
        document: plain values, as JSON holds them.
    """

    name: str
    tensors: dict[str, torch.Tensor]
    document: dict[str, Any]


class CheckpointStore:
    """Checkpoints of one run: `<folder>/<update>/`, the pointers `last` and `best`, old ones pruned.

    A checkpoint is written under a temporary name, synced and renamed, so a folder with a proper name is complete. Its
    manifest holds size and SHA-256 of each file; loading checks them. A pointer that is damaged or lost is put right
    from the folders that are there.

    Args:
        folder: made when missing.
        keep: newest checkpoints to keep.
        writer: make the folder, and remove what a killed writer left unfinished; False beside a running learner.
    """

    def __init__(self, folder: Path, keep: int, *, writer: bool = True) -> None:
        self.folder = folder
        self._keep = keep
        if not writer:
            return
        try:
            make_folder(folder)
            for replaced in folder.glob(f".*{_REPLACED}"):
                self._put_back(replaced)
            for leftover in folder.glob(".*.tmp"):
                shutil.rmtree(leftover) if leftover.is_dir() else leftover.unlink()
            self.mend_pointers()
        except OSError as error:
            raise StorageError(f"cannot prepare {folder}: {refusal(error)}") from error

    def names(self) -> list[str]:
        """Names of the training checkpoints, oldest first."""
        return sorted(path.name for path in self.folder.glob("[0-9]*") if path.is_dir() and path.name.isdigit())

    def save(self, update: int, tensors: Mapping[str, torch.Tensor], document: Mapping[str, Any]) -> Path:
        """Write a checkpoint, let `last` point at it and prune; the same update again replaces its folder.

        Raises:
            StorageError: when the disk refuses it; the checkpoints then are as they were.
        """
        target = self._write(f"{update:09d}", tensors, document)
        self._point("last", target.name)
        for name in self.names()[: -self._keep]:
            self._remove(name)
        return target

    def save_best(self, version: int, tensors: Mapping[str, torch.Tensor], document: Mapping[str, Any]) -> Path:
        """Write the policy of the best evaluation so far and let `best` point at it; the one before goes.

        Raises:
            StorageError: when the disk refuses it; the one before stays.
        """
        target = self._write(f"policy-{version:09d}", tensors, document)
        self._point("best", target.name)
        for path in self.folder.glob("policy-*"):
            if path.name != target.name:
                self._remove(path.name)
        return target

    def pointer(self, which: str) -> str | None:
        """Name that `last` or `best` points at, None where there is none yet.

        A pointer that names no checkpoint is reported, and the newest one there is taken.
        """
        known, name = self._known(which), self._read_pointer(which)
        if which not in self.damaged_pointers():
            return name
        newest = known[-1] if known else None
        logger.error("%s is damaged: it names no checkpoint; using the newest one, %s", self.folder / which, newest)
        return newest

    def damaged_pointers(self) -> list[str]:
        """Names of the pointers that name no checkpoint, or are missing although there is one."""
        wrong = []
        for which in ("last", "best"):
            known, name = self._known(which), self._read_pointer(which)
            if name not in known and (known or name is not None):
                wrong.append(which)
        return wrong

    def mend_pointers(self) -> None:
        """Let damaged pointers name the newest checkpoint that there is, and delete those that nothing is left for."""
        for which in self.damaged_pointers():
            name = self.pointer(which)
            if name is None:
                (self.folder / which).unlink(missing_ok=True)
            else:
                self._point(which, name)

    def document(self, name: str) -> dict[str, Any]:
        """Read the plain values of a checkpoint alone, unchecked."""
        return json.loads((self.folder / name / _DOCUMENT).read_text("utf-8"))

    def load(self, name: str) -> Checkpoint:
        """Load one checkpoint after checking it.

        Raises:
            CheckpointError: when it is missing, incomplete or damaged, naming the file.
        """
        folder = self.folder / name
        self._check(folder)
        try:
            document = json.loads((folder / _DOCUMENT).read_text("utf-8"))
            return Checkpoint(name, load_file(folder / _TENSORS), document)
        except (OSError, ValueError, SafetensorError) as error:
            raise CheckpointError(f"checkpoint {folder} cannot be read: {error}") from error

    def load_newest(self) -> Checkpoint:
        """Load the newest checkpoint that is sound; damaged ones are reported by name and passed over.

        Raises:
            CheckpointError: when none is left.
        """
        names = self.names()
        problems = []
        for name in reversed(names):
            try:
                checkpoint = self.load(name)
            except CheckpointError as error:
                logger.error("%s; trying the checkpoint before", error)
                problems.append(str(error))
                continue
            if problems:
                logger.warning("continuing from checkpoint %s instead of %s", name, names[-1])
            return checkpoint
        if problems:
            raise CheckpointError(f"no checkpoint in {self.folder} is usable: {'; '.join(problems)}")
        raise CheckpointError(f"there is no checkpoint in {self.folder}: start over with --overwrite")

    def damaged(self) -> dict[str, str]:
        """Return what is wrong with each checkpoint, and with each best policy, that cannot be loaded, by its name."""
        problems = {}
        for name in [*self.names(), *self._policies()]:
            try:
                self._check(self.folder / name)
            except CheckpointError as error:
                problems[name] = str(error)
        return problems

    def set_aside(self, name: str) -> Path:
        """Rename a checkpoint or a best policy that cannot be used to `damaged-...`; return where it lies now."""
        aside = self.folder / f"damaged-{name}"
        shutil.rmtree(aside, ignore_errors=True)
        (self.folder / name).rename(aside)
        return aside

    def set_aside_after(self, name: str) -> None:
        """Rename the checkpoints newer than ``name``, which a resumed run has passed over, to `damaged-...`."""
        for other in self.names():
            if other > name:
                self.set_aside(other)

    def _write(self, name: str, tensors: Mapping[str, torch.Tensor], document: Mapping[str, Any]) -> Path:
        target = self.folder / name
        temporary = self.folder / f".{name}.{os.getpid()}.tmp"
        replaced = self.folder / f".{name}{_REPLACED}"
        shutil.rmtree(temporary, ignore_errors=True)
        try:
            temporary.mkdir()
            plain = {key: value.detach().cpu().contiguous().clone() for key, value in tensors.items()}
            save_file(plain, temporary / _TENSORS)
            (temporary / _DOCUMENT).write_text(to_json(document), "utf-8")
            # safetensors makes its file for the owner alone, whatever the umask allows.
            with contextlib.suppress(OSError):  # a file system without permissions
                (temporary / _TENSORS).chmod(stat.S_IMODE((temporary / _DOCUMENT).stat().st_mode))
            files = {
                path.name: {"bytes": path.stat().st_size, "sha256": file_digest(path)}
                for path in sorted(temporary.iterdir())
            }
            (temporary / _MANIFEST).write_text(to_json({"format": FORMAT, "files": files}), "utf-8")
            for path in temporary.iterdir():
                sync_path(path)
            sync_path(temporary)
            if target.exists():
                target.rename(replaced)
            temporary.rename(target)
            sync_path(self.folder)
            shutil.rmtree(replaced, ignore_errors=True)
        except (OSError, SafetensorError) as error:
            shutil.rmtree(temporary, ignore_errors=True)
            self._put_back(replaced)
            needed = 2 * sum(tensor.nbytes for tensor in tensors.values())
            reason = refusal(error) if isinstance(error, OSError) else f"{error}; make room on the disk"
            raise StorageError(f"cannot write checkpoint {self.folder / name}: {reason}", needed) from error
        return target

    def _put_back(self, replaced: Path) -> None:
        """Bring a folder back that was taken away for a new one which then did not take its place."""
        target = self.folder / replaced.name.removeprefix(".").removesuffix(_REPLACED)
        with contextlib.suppress(CheckpointError, OSError):
            if not target.exists():
                self._check(replaced)
                replaced.rename(target)

    def _known(self, which: str) -> list[str]:
        return self.names() if which == "last" else self._policies()

    def _read_pointer(self, which: str) -> str | None:
        path = self.folder / which
        try:
            return path.read_text("utf-8").strip() if path.exists() else None
        except (OSError, UnicodeDecodeError):
            return ""

    def _policies(self) -> list[str]:
        """Names of the best policies, oldest version first: one, or two while one is being replaced."""
        return sorted(path.name for path in self.folder.glob("policy-*") if path.is_dir())

    def _point(self, which: str, name: str) -> None:
        try:
            replace_text(self.folder / which, name + "\n")
        except OSError as error:
            raise StorageError(f"cannot write {self.folder / which}: {refusal(error)}", len(name)) from error

    def _remove(self, name: str) -> None:
        """Take a folder out of sight at one stroke, then delete it; what cannot be deleted goes at the next start."""
        doomed = self.folder / f".{name}.{os.getpid()}.tmp"
        (self.folder / name).rename(doomed)
        shutil.rmtree(doomed, ignore_errors=True)

    def _check(self, folder: Path) -> None:
        try:
            manifest = read_json(folder / _MANIFEST)
            files = manifest["files"]
            written = manifest["format"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise CheckpointError(
                f"checkpoint {folder} is incomplete: its {_MANIFEST} cannot be read ({error})"
            ) from error
        if written != FORMAT:
            raise CheckpointError(f"checkpoint {folder} has format {written}, this software reads format {FORMAT}")
        for name in (_TENSORS, _DOCUMENT):
            path = folder / name
            if name not in files or not path.is_file():
                raise CheckpointError(f"checkpoint {folder} is incomplete: {name} is missing")
            expected = files[name]
            if not isinstance(expected, dict) or not {"bytes", "sha256"} <= set(expected):
                raise CheckpointError(f"checkpoint {folder} is damaged: its {_MANIFEST} gives no digest of {name}")
            if path.stat().st_size != expected["bytes"] or file_digest(path) != expected["sha256"]:
                raise CheckpointError(f"checkpoint {folder} is damaged: {name} does not match its digest")
