"""Results files of an evaluation at a large scale: one per planner, with all that a recount needs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from actors.evaluation.outcome import Outcome
from actors.evaluation.results import (
    PLACES,
    Coordinate,
    DecisionTime,
    Distance,
    EpisodeResult,
    Name,
    Record,
    Results,
    ResultsError,
    TaskId,
    collect,
    read_record,
)
from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.worlds import WorldSet
from actors.maps.grid_map import GridMap
from common.config.section import Length
from common.problems import first_problem
from common.registry import refuse_modules

Count = Annotated[int, Field(ge=0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class LegResult(Record):
    """The way to one target; see `actors.evaluation.outcome.Leg`."""

    target: tuple[Coordinate, Coordinate]
    distance_m: Distance
    time_s: Distance
    steps: Count
    collisions: Count
    success: bool
    reason: str


class LargeEpisode(Record):
    """One exploration, or one tour.

    Attributes:
        map: name of the world.
        distance_m: travelled metres.
        time_s: simulated seconds of driving; computing takes no simulated time.
        steps: decisions that were carried out.
        success: exploration: enough was seen; tour: every target was reached.
        reason: why it ended.
        collisions: contacts with walls.
        volume_m3: explored volume.
        explored_rate: share of the reachable free area that was seen; 0 for tours.
        decision_ms: processor time of every decision, mapping included.
        waypoints: (x, y) of the start and of every arrival, pixels of the image; on a tour those of each leg.
        curve: (seconds, metres, cubic metres, explored share) at the start and after every decision.
        track: (seconds, x, y, yaw) at every scan, metres and radians in the map frame.
        legs: of a tour.
    """

    map: Name
    distance_m: Distance
    time_s: Distance
    steps: Count
    success: bool
    reason: str
    collisions: Count
    volume_m3: Distance
    explored_rate: Share
    decision_ms: list[Distance]
    waypoints: Annotated[list[tuple[Coordinate, Coordinate]], Field(min_length=1)]
    curve: list[tuple[Distance, Distance, Distance, Share]]
    track: list[tuple[Distance, Coordinate, Coordinate, Coordinate]]
    legs: list[LegResult] = Field(default_factory=list)

    @property
    def decision(self) -> DecisionTime:
        """Median and 95th percentile of the decision time."""
        times = np.array(self.decision_ms or [0.0])
        return DecisionTime(median=float(np.median(times)), p95=float(np.quantile(times, 0.95)))

    @property
    def volume_per_metre(self) -> float:
        """Explored volume per travelled metre, m² (m³/m); 0 for a robot that never moved."""
        return self.volume_m3 / self.distance_m if self.distance_m > 0.0 else 0.0


class LargeResults(Record):
    """What one planner did in a set of large worlds.

    Attributes:
        kind: tells these files from those of `hd-eval run`.
        task: `exploration` or `navigation`.
        metres_per_pixel: scale of the worlds.
        sensor_range_m: range of the sensor, metres.
        planner: name.
        commit: of the code that made it.
        seed: of the run.
        settings: all settings that the episodes depend on, as the journal has them.
        worlds: number of worlds that were to be done.
        episodes: one per world.
    """

    kind: Literal["large"] = "large"
    task: TaskId
    metres_per_pixel: Length
    sensor_range_m: Length
    planner: Name
    commit: str
    seed: int
    settings: dict[str, Any]
    worlds: Annotated[int, Field(ge=1)]
    episodes: list[LargeEpisode]

    def plain(self) -> Results:
        """Return distances, success and decision times in the form that paired comparisons take."""
        episodes = [
            EpisodeResult(
                map=episode.map,
                waypoints=episode.waypoints,
                distance_m=episode.distance_m,
                steps=episode.steps,
                success=episode.success,
                explored_rate=episode.explored_rate,
                decision_ms=episode.decision,
            )
            for episode in self.episodes
        ]
        return Results(
            task=self.task,
            metres_per_pixel=self.metres_per_pixel,
            sensor_range_m=self.sensor_range_m,
            planner=self.planner,
            commit=self.commit,
            seed=self.seed,
            episodes=episodes,
        )


def large_results(
    settings: EvaluationSettings, planner: str, commit: str, worlds: int, named: Sequence[tuple[str, Outcome]]
) -> LargeResults:
    """Return the results of a planner.

    Args:
        settings: of the evaluation.
        planner: name.
        commit: of the code that ran the episodes.
        worlds: number of worlds that were to be done.
        named: the names of the worlds, and how their episodes went.
    """
    return LargeResults(
        task=settings.task.kind.name,
        metres_per_pixel=settings.metres_per_pixel,
        sensor_range_m=settings.mapping.sensor_range,
        planner=planner,
        commit=commit,
        seed=settings.seed,
        settings=settings.fingerprint(planner),
        worlds=worlds,
        episodes=[_episode(name, outcome) for name, outcome in named],
    )


def read_large_results(path: Path) -> LargeResults:
    """Read and check a results file.

    Raises:
        ResultsError: it cannot be read, or breaks the format.
    """
    return read_record(path, LargeResults, "hd-eval large")


def collect_large_results(places: Sequence[str | Path]) -> list[LargeResults]:
    """Read results files, and all of those in folders; in the order given, those of a folder by name.

    Raises:
        ResultsError: there is none, a file is damaged, two have the same planner, or tasks and scales differ.
    """
    return collect(places, read_large_results, "hd-eval large")


def worlds_of(results: LargeResults, names: Sequence[str]) -> dict[str, GridMap]:
    """Make the worlds of a results file by their names.

    Raises:
        ResultsError: the settings of the file are none of this version.
        MapError: its source has no such world.
    """
    settings = settings_of(results)
    worlds = WorldSet.open(settings.maps, settings.map_task, settings.metres_per_pixel, results.worlds)
    return {name: worlds.load(number) for name, number in worlds.find(list(dict.fromkeys(names))).items()}


def settings_of(results: LargeResults) -> EvaluationSettings:
    """Return the settings that made a results file; `ResultsError` when they are none of this version."""
    try:
        settings = EvaluationSettings.model_validate({**results.settings, "large": True})
    except ValidationError as error:
        raise ResultsError(
            f"the settings of {results.planner!r} do not fit this version ({first_problem(error).words}): "
            "use the version that made them"
        ) from error
    refuse_modules(settings.named_parts(), (), f"the results file of {results.planner!r}", "install it as a package")
    return settings


def _episode(name: str, outcome: Outcome) -> LargeEpisode:
    return LargeEpisode(
        map=name,
        distance_m=round(outcome.distance, PLACES),
        time_s=outcome.time,
        steps=outcome.steps,
        success=outcome.success,
        reason=outcome.reason,
        collisions=outcome.collisions,
        volume_m3=outcome.volume,
        explored_rate=round(outcome.explored, 6),
        decision_ms=[round(time, 3) for time in outcome.decision_ms],
        waypoints=outcome.waypoints,
        curve=outcome.curve,
        track=[(time, x, y, yaw) for time, x, y, yaw in outcome.track],
        legs=[LegResult(**leg) for leg in outcome.legs],
    )
