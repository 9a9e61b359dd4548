"""A disk that forgets: what a power failure may leave of the file operations that `record_io.c` has recorded.

Everything that was synced before the failure is there. Of everything else, each file and each folder keeps by itself
what its `Kept` says, which is drawn; a write may also be there in part, or as zeros of its length. That is more than
any real file system loses.
"""

from __future__ import annotations

import enum
import random
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple

_HEAD = struct.Struct("<cQQII")
SECTOR = 512


class Operation(NamedTuple):
    """One recorded operation; see `record_io.c`."""

    code: str
    inode: int
    number: int
    first: bytes
    second: bytes


def read_log(path: Path) -> list[Operation]:
    """Read all whole records."""
    content = path.read_bytes()
    operations, place = [], 0
    while place + _HEAD.size <= len(content):
        code, inode, number, a, b = _HEAD.unpack_from(content, place)
        place += _HEAD.size
        operations.append(Operation(code.decode(), inode, number, content[place : place + a], content[place + a :][:b]))
        place += a + b
    return operations


class Kept(enum.Enum):
    """What a file or a folder keeps of the changes that were not synced."""

    NONE = "none"
    ALL = "all"
    EARLIER = "earlier"
    ANY = "any"


class _Node:
    """A file or a folder: what is on the disk for certain, and the changes since."""

    def __init__(self, folder: bool) -> None:
        self.folder = folder
        self.entries: dict[str, _Node] = {}
        """Entries of a folder as the process sees them."""
        self.durable: dict[str, _Node] | bytearray = {} if folder else bytearray()
        self.pending: list[tuple] = []

    def settle(self, count: int) -> None:
        """Put the first changes onto the disk."""
        for change in self.pending[:count]:
            _apply(self.durable, change)
        del self.pending[:count]


class DiskModel:
    """Replays operations, and makes what a failure between two of them may leave.

    Args:
        root: the recorded folder, empty and on the disk when recording began.
        kept: what files and folders may keep of the changes that were not synced.
    """

    def __init__(self, root: Path, kept: Sequence[Kept] = tuple(Kept)) -> None:
        self._kept = kept
        self._root_path = PurePosixPath(root)
        self._root = _Node(folder=True)
        self._inodes: dict[int, _Node] = {}
        self._syncs: dict[int, tuple[_Node, list]] = {}
        self.marks: list[str] = []

    def learn_root(self, inode: int) -> None:
        """Tell the inode of the recorded folder itself."""
        self._inodes[inode] = self._root

    def replay(self, operation: Operation) -> None:
        """Carry one operation out."""
        match operation.code:
            case "A":
                self.marks.append(operation.first.decode())
            case "C" | "M":
                folder, name = self._place(operation.first)
                node = self._inodes[operation.inode] = _Node(operation.code == "M")
                folder.entries[name] = node
                folder.pending.append(("link", name, node))
            case "U" | "X":
                folder, name = self._place(operation.first)
                del folder.entries[name]
                folder.pending.append(("unlink", name))
            case "R":
                folder, old = self._place(operation.first)
                target, new = self._place(operation.second)
                assert folder is target, "only renaming within a folder is modelled"
                node = folder.entries.pop(old)
                folder.entries[new] = node
                folder.pending.append(("rename", old, new, node))
            case "W":
                self._inodes[operation.inode].pending.append(("write", operation.number, operation.first))
            case "T":
                self._inodes[operation.inode].pending.append(("length", operation.number))
            case "s":
                node = self._inodes[operation.inode]
                self._syncs[operation.number] = node, list(node.pending)
            case "S":
                node, covered = self._syncs.pop(operation.number)
                left = {id(change) for change in node.pending}
                node.settle(sum(id(change) in left for change in covered))

    def crash(self, out: Path, chance: random.Random) -> None:
        """Write one thing that may be left of the recorded folder into the folder ``out``."""
        for name, node in self._left(self._root, chance).items():
            self._write(node, out / name, chance)

    def _place(self, path: bytes) -> tuple[_Node, str]:
        parts = PurePosixPath(path.decode()).relative_to(self._root_path).parts
        folder = self._root
        for part in parts[:-1]:
            folder = folder.entries[part]
        return folder, parts[-1]

    def _left(self, node: _Node, chance: random.Random):
        """What is left of a node's own content."""
        content = node.durable.copy()
        for change in selection(node.pending, chance.choice(self._kept), chance):
            broken = change[0] == "write" and chance.random() < 0.2
            _apply(content, _broken(change, chance) if broken else change)
        return content

    def _write(self, node: _Node, path: Path, chance: random.Random) -> None:
        left = self._left(node, chance)
        if node.folder:
            path.mkdir()
            for name, child in left.items():
                self._write(child, path / name, chance)
        else:
            path.write_bytes(left)


def selection(pending: list, kept: Kept, chance: random.Random) -> Iterator:
    """Yield those of the changes since the last sync that are on the disk all the same."""
    earlier = chance.randrange(len(pending) + 1)
    for number, change in enumerate(pending):
        match kept:
            case Kept.ALL:
                there = True
            case Kept.EARLIER:
                there = number < earlier
            case Kept.ANY:
                there = chance.random() < 0.5
            case Kept.NONE:
                there = False
        if there:
            yield change


def _broken(change: tuple, chance: random.Random) -> tuple:
    _, place, data = change
    cut = chance.randrange(len(data) // SECTOR + 1) * SECTOR
    return "write", place, data[:cut] + (bytes(len(data) - cut) if chance.random() < 0.5 else b"")


def _apply(content, change: tuple) -> None:
    match change:
        case ("link", name, node):
            content[name] = node
        case ("unlink", name):
            content.pop(name, None)
        case ("rename", old, new, node):
            content.pop(old, None)
            content[new] = node
        case ("length", size):
            content[size:] = bytes(max(0, size - len(content)))
        case ("write", place, data):
            content[len(content) :] = bytes(max(0, place - len(content)))
            content[place : place + len(data)] = data
