"""The journal of one planner's evaluation: a line for each finished episode, so that a run can be resumed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from actors.evaluation.outcome import Outcome
from actors.evaluation.results import ResultsError
from common.system.documents import parse_json

FORMAT = 1


class Journal:
    """Episodes of one planner, kept in a file that only grows.

    The first line tells what the episodes depend on; a run with other settings cannot be joined to it.

    Usage::

        journal = Journal.open(path, settings.fingerprint("greedy"))
        journal.add(3, outcome, commit)

    Attributes:
        outcomes: finished episodes by the number of their world.
        commits: of the code that made them, in order of first appearance.
        digests: of the files of their worlds, by number; empty for generated ones and in journals of earlier versions.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.outcomes: dict[int, Outcome] = {}
        self.commits: list[str] = []
        self.digests: dict[int, str] = {}

    @classmethod
    def open(cls, path: Path, fingerprint: Mapping[str, Any]) -> Journal:
        """Read a journal, or begin one.

        A last line that was cut off when a run was killed is left out, and so are crashed episodes: these are run
        again.

        Raises:
            ResultsError: the file is of other settings, damaged, or cannot be read or written.
        """
        journal = cls(path)
        head = {"format": FORMAT, "settings": json.loads(json.dumps(fingerprint))}
        try:
            lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
            if not lines:
                path.write_text(json.dumps(head) + "\n", "utf-8")
                return journal
            if not lines[-1].endswith(b"\n"):
                # A line that was cut off must not be continued by the next one.
                with path.open("r+b") as file:
                    file.truncate(sum(len(line) for line in lines[:-1]))
                del lines[-1]
            if not lines:
                path.write_text(json.dumps(head) + "\n", "utf-8")
                return journal
            journal._read(lines, head)
        except OSError as error:
            raise ResultsError(f"cannot use {path} ({error.strerror}): check the folder") from error
        return journal

    def add(self, number: int, outcome: Outcome, commit: str, digest: str = "") -> None:
        """Append an episode.

        Args:
            number: of its world.
            outcome: how it went.
            commit: of the code.
            digest: of the files of its world.

        Raises:
            ResultsError: the file cannot be written.
        """
        self._take(number, outcome, commit, digest)
        line = json.dumps({"number": number, "commit": commit, "map": digest, **asdict(outcome)})
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:
            raise ResultsError(f"cannot write {self._path} ({error.strerror}): check the space left") from error

    def _read(self, lines: list[bytes], head: Mapping[str, Any]) -> None:
        try:
            first = parse_json(lines[0])
            if first != head:
                raise ResultsError(
                    f"{self._path} is of a run with other settings ({_difference(first, head)}): choose another --out, "
                    "or start over with --overwrite"
                )
            for line in lines[1:]:
                values = parse_json(line)
                number, commit, digest = values.pop("number"), values.pop("commit"), values.pop("map", "")
                values["waypoints"] = [(float(x), float(y)) for x, y in values["waypoints"]]
                outcome = Outcome(**values)
                if not outcome.crashed:
                    self._take(number, outcome, commit, digest)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ResultsError(f"{self._path} is damaged ({error}): start over with --overwrite") from error

    def _take(self, number: int, outcome: Outcome, commit: str, digest: str) -> None:
        self.outcomes[number] = outcome
        self.digests[number] = digest
        if commit not in self.commits:
            self.commits.append(commit)


def _difference(a: Any, b: Any, path: str = "") -> str:
    """Return where two trees of plain values differ first, in words."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted({*a, *b}):
            if a.get(key) != b.get(key):
                return _difference(a.get(key), b.get(key), f"{path}.{key}" if path else key)
    return f"{path.removeprefix('settings.')}: {a!r} in the results, {b!r} now"
