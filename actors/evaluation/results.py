"""Results files: one per planner, in a format that anyone can replay and recount."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from actors.evaluation.packing import SUFFIXES, pack, unpack
from common.config.section import Length
from common.errors import HDError
from common.ids import ID_PATTERN
from common.problems import first_problem
from common.system.paths import exists
from common.system.remote_files import fetched
from common.system.stand_ins import stand_in
from common.system.text_files import decode_text

# Coordinates and distances are rounded to so many places: far below a cell, and files stay small.
PLACES = 4

Distance = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Coordinate = Annotated[float, Field(allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=1000)]
# Never MODULE:CLASS: a results file of others must not name code.
TaskId = Annotated[str, Field(pattern=rf"^{ID_PATTERN.pattern}$")]


class ResultsError(HDError):
    """A results file cannot be read, or does not say what it should."""


class Record(BaseModel):
    """Part of a results file; fields beyond the format are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class DecisionTime(Record):
    """Processor time from a scan to the next waypoint (mapping, planning), milliseconds, over the decisions made."""

    median: Distance
    p95: Distance


class EpisodeResult(Record):
    """One episode.

    Attributes:
        map: name of the map's file, with the folders that tell it apart from others of that name.
        waypoints: (x, y) in pixels of the image, the start first; x right, y down, from the centre of the top-left
            pixel.
        distance_m: travelled metres.
        steps: decisions that were carried out.
        success: the task was completed.
        explored_rate: share of the reachable free area that was seen, 0 to 1.
        decision_ms: decision time; that of the processor, so that another load of the machine does not change it much.
        corners: those of the waypoints, by number, at which the robot scanned but nothing was decided, ascending:
            corners of ways that are not straight.
        reason: why it ended, in words.
        unseen_m2: reachable area that an exploration left unseen although it ended, square metres; 0 when complete.
    """

    map: Name
    waypoints: Annotated[list[tuple[Coordinate, Coordinate]], Field(min_length=1)]
    distance_m: Distance
    steps: Annotated[int, Field(ge=0)]
    success: bool
    explored_rate: Annotated[float, Field(ge=0.0, le=1.0)]
    decision_ms: DecisionTime
    corners: list[Annotated[int, Field(ge=1)]] = []
    reason: str = ""
    unseen_m2: Distance = 0.0


class Results(Record):
    """What one planner did on a set of maps.

    Attributes:
        task: name of the task, such as `exploration`.
        metres_per_pixel: scale of the maps.
        sensor_range_m: range of the sensor, metres.
        units: of the waypoints.
        planner: name of the planner.
        commit: of the code that made it.
        seed: of the run.
        episodes: one per map.
    """

    task: TaskId
    metres_per_pixel: Length
    sensor_range_m: Length
    units: Literal["px"] = "px"
    planner: Name
    commit: str
    seed: int
    episodes: list[EpisodeResult]

    @model_validator(mode="after")
    def _maps_are_different(self) -> Results:
        names = [episode.map for episode in self.episodes]
        twice = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
        if twice:
            raise ValueError(f"map {twice[0]!r} occurs more than once")
        return self


class _Head(Record):
    """What tells results files of one protocol from those of another."""

    kind: str = ""
    planner: Name
    metres_per_pixel: Length
    episodes: list[dict[str, Any]]


class AnyResults(Protocol):
    """What the results files of all protocols have in common."""

    @property
    def task(self) -> str:
        """What was done."""
        ...

    @property
    def metres_per_pixel(self) -> float:
        """Scale of the worlds."""
        ...

    @property
    def planner(self) -> str:
        """Who did it."""
        ...


R = TypeVar("R", bound=BaseModel)
A = TypeVar("A", bound=AnyResults)


def write_results(path: Path, results: Results) -> None:
    """Write a results file, one episode per line; readers see the old file or the whole new one.

    Raises:
        ResultsError: the file cannot be written.
    """
    write_record(path, results, results.episodes)


def write_record(path: Path, results: BaseModel, episodes: Sequence[BaseModel]) -> None:
    """Write results of any protocol; their field `episodes` comes last. See `write_results`."""
    head = results.model_dump_json(exclude={"episodes"})
    lines = ",\n".join(episode.model_dump_json() for episode in episodes)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_text(f'{head[:-1]},"episodes":[\n{lines}\n]}}\n', "utf-8")
        temporary.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise ResultsError(f"cannot write {path} ({error.strerror}): check the folder and the space left") from error


def read_results(path: Path) -> Results:
    """Read and check a results file; fields that it has beyond the format are ignored.

    Raises:
        ResultsError: it cannot be read, or breaks the format.
    """
    return read_record(path, Results, "hd-eval run")


def read_record(path: Path, kind: type[R], command: str) -> R:
    """Read and check results of some kind, which a command makes. See `read_results`."""
    try:
        data = path.read_bytes()
        if instead := stand_in(data):
            raise ValueError(f"it {instead}")
        text = decode_text(unpack(data))
        try:
            return kind.model_validate_json(text)
        except ValidationError:
            made_by, shown_by = _maker(text)
            if made_by in (None, command):
                raise
            raise ResultsError(
                f"expected results of '{command}', got those of '{made_by}' in {path}: take {shown_by} for them"
            ) from None
    except OSError as error:
        raise ResultsError(f"cannot read {path} ({error.strerror}): name a results file of '{command}'") from error
    except ValidationError as error:
        first = first_problem(error)
        raise ResultsError(
            f"{path} is not a results file of '{command}': {first.path or 'the file'}: {first.words} "
            f"({error.error_count()} problems)"
        ) from error
    except ValueError as error:
        raise ResultsError(f"{path} is no results file of '{command}': {error}") from error


def _maker(text: str) -> tuple[str | None, str]:
    """Return the command that made a results file, None when it is none, and the commands that show such files."""
    try:
        head = _Head.model_validate_json(text)
    except ValidationError:
        return None, ""
    if head.kind == "large":
        return "hd-eval large", "'hd-eval large-table', 'large-plot' or 'large-recount'"
    return "hd-eval run", "'hd-eval table', 'plot' or 'replay'"


def write_packed(path: Path, place: Path) -> None:
    """Write a results file once more, packed for keeping: equal results give equal bytes.

    Raises:
        ResultsError: one of both files cannot be read or written.
    """
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(pack(path.read_bytes()))
    except OSError as error:
        raise ResultsError(f"cannot pack {path} into {place} ({error.strerror}): check both") from error


def collect_results(places: Sequence[str | Path]) -> list[Results]:
    """Read results files, and all of those in folders, packed ones too; in the order given, those of a folder by name.

    Each place is a path or a URL.

    Raises:
        ResultsError: there is none, a file is damaged, two have the same planner, or tasks and scales differ.
    """
    return collect(places, read_results, "hd-eval run")


def collect(places: Sequence[str | Path], read: Callable[[Path], A], command: str) -> list[A]:
    """Read results of some kind, which a command makes. See `collect_results`."""
    files: list[Path] = []
    try:
        with fetched(places, (".json", *SUFFIXES)) as local:
            for place in local:
                # Hidden ones are notes of a file system, such as the ._NAME of a stick that was in a Mac.
                named = [file for suffix in (".json", *SUFFIXES) for file in place.glob(f"[!.]*{suffix}")]
                files += sorted(named) if exists(place) and place.is_dir() else [place]
            found = [read(file) for file in files]
    except FileNotFoundError as error:
        raise ResultsError(f"there is no results file {error}: make one with '{command}'") from error
    if not files:
        raise ResultsError(f"there are no results files in {', '.join(map(str, places))}: make some with '{command}'")
    first = found[0]
    for file, results in zip(files, found, strict=True):
        if (results.task, results.metres_per_pixel) != (first.task, first.metres_per_pixel):
            raise ResultsError(f"{file} has another task or scale than {files[0]}: compare results of the same kind")
    planners = [results.planner for results in found]
    for name in planners:
        if planners.count(name) > 1:
            raise ResultsError(f"two results files are of planner {name!r}: choose one of them")
    return found
