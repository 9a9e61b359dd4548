"""Checkpoints: folders of safetensors and JSON that are whole or absent, with digests that betray damage."""

from __future__ import annotations

import json
import logging
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from common.errors import CheckpointError
from learner.run.files import file_digest, replace_text, sync_path, to_json

logger = logging.getLogger(__name__)

FORMAT = 1
_MANIFEST = "manifest.json"
_DOCUMENT = "state.json"
_TENSORS = "tensors.safetensors"


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
    manifest holds size and SHA-256 of each file; loading checks them.

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
        folder.mkdir(parents=True, exist_ok=True)
        for leftover in folder.glob(".*.tmp"):
            shutil.rmtree(leftover) if leftover.is_dir() else leftover.unlink()

    def names(self) -> list[str]:
        """Names of the training checkpoints, oldest first."""
        return sorted(path.name for path in self.folder.iterdir() if path.is_dir() and path.name.isdigit())

    def save(self, update: int, tensors: Mapping[str, torch.Tensor], document: Mapping[str, Any]) -> Path:
        """Write a checkpoint, let `last` point at it and prune; the same update again replaces its folder."""
        target = self._write(f"{update:09d}", tensors, document)
        replace_text(self.folder / "last", target.name + "\n")
        for name in self.names()[: -self._keep]:
            self._remove(name)
        return target

    def save_best(self, version: int, tensors: Mapping[str, torch.Tensor], document: Mapping[str, Any]) -> Path:
        """Write the policy of the best evaluation so far and let `best` point at it; the one before goes."""
        target = self._write(f"policy-{version:09d}", tensors, document)
        replace_text(self.folder / "best", target.name + "\n")
        for path in self.folder.glob("policy-*"):
            if path.name != target.name:
                self._remove(path.name)
        return target

    def pointer(self, which: str) -> str | None:
        """Name that `last` or `best` points at, None where there is none yet."""
        path = self.folder / which
        return path.read_text("utf-8").strip() if path.is_file() else None

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
        raise CheckpointError(f"there is no checkpoint in {self.folder}: start the run anew with --overwrite")

    def set_aside_after(self, name: str) -> None:
        """Rename the checkpoints newer than ``name``, which a resumed run has passed over, to `damaged-...`."""
        for other in self.names():
            if other > name:
                aside = self.folder / f"damaged-{other}"
                shutil.rmtree(aside, ignore_errors=True)
                (self.folder / other).rename(aside)

    def _write(self, name: str, tensors: Mapping[str, torch.Tensor], document: Mapping[str, Any]) -> Path:
        temporary = self.folder / f".{name}.{os.getpid()}.tmp"
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir()
        try:
            plain = {key: value.detach().cpu().contiguous().clone() for key, value in tensors.items()}
            save_file(plain, temporary / _TENSORS)
            (temporary / _DOCUMENT).write_text(to_json(document), "utf-8")
            files = {
                path.name: {"bytes": path.stat().st_size, "sha256": file_digest(path)}
                for path in sorted(temporary.iterdir())
            }
            (temporary / _MANIFEST).write_text(to_json({"format": FORMAT, "files": files}), "utf-8")
            for path in temporary.iterdir():
                sync_path(path)
            sync_path(temporary)
            target = self.folder / name
            if target.exists():
                self._remove(name)
            temporary.rename(target)
        except OSError as error:
            shutil.rmtree(temporary, ignore_errors=True)
            raise CheckpointError(
                f"cannot write checkpoint {self.folder / name}: {error}; make room on the disk"
            ) from error
        sync_path(self.folder)
        return target

    def _remove(self, name: str) -> None:
        """Take a folder out of sight at one stroke, then delete it."""
        doomed = self.folder / f".{name}.{os.getpid()}.old.tmp"
        (self.folder / name).rename(doomed)
        shutil.rmtree(doomed)

    def _check(self, folder: Path) -> None:
        try:
            manifest = json.loads((folder / _MANIFEST).read_text("utf-8"))
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
            if path.stat().st_size != expected["bytes"] or file_digest(path) != expected["sha256"]:
                raise CheckpointError(f"checkpoint {folder} is damaged: {name} does not match its digest")
