"""A video of one episode: the belief grows, the robot drives, beacons and frontiers come and go."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from actors.evaluation.pixels import Position, to_pixels
from actors.evaluation.plots import belief_picture
from actors.evaluation.results import EpisodeResult, Results, ResultsError
from actors.evaluation.retrace import Moment, retrace
from actors.evaluation.settings import EvaluationSettings
from actors.maps.grid_map import GridMap
from common import palette
from common.system.extras import optional
from common.tasks import find_task

SUFFIXES = (".gif", ".mp4")
# Pictures of the robot on its way between two waypoints, the arrival included.
FRAMES_PER_STEP = 4
HOLD_LAST = 12
STRIP = 22

_FRONTIER = palette.FRONTIER.rgb
_ROUTE = palette.WAY.rgb
_BEACON = palette.BEACON.rgb
_TARGET = palette.TARGET.rgb
_ROBOT = palette.ROBOT.rgb
_TEXT = palette.TEXT.rgb


def write_video(
    results: Results,
    episode: EpisodeResult,
    world: GridMap,
    settings: EvaluationSettings,
    path: Path,
    *,
    fps: int = 10,
    width: int = 640,
) -> int:
    """Drive an episode again and write what the robot knows as GIF or MP4.

    Args:
        results: the file that the episode stands in.
        episode: the episode.
        world: its map.
        settings: task and mapping.
        path: ends in .gif (Pillow) or .mp4 (imageio with its own ffmpeg).
        fps: pictures per second.
        width: of the video, pixels.

    Returns:
        Number of pictures.

    Raises:
        ResultsError: the suffix is another one, or the file cannot be written.
        ConfigError: imageio is not installed.
    """
    return write_frames(_frames(results, episode, world, settings, width), path, fps)


def write_frames(frames: Iterator[Image.Image], path: Path, fps: int = 10) -> int:
    """Write pictures of one size, both sides even, as GIF or MP4 and return their number.

    Raises:
        ResultsError: the suffix is another one, or the file cannot be written.
        ConfigError: imageio is not installed.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ResultsError(f"a video ends in .gif or .mp4, got {path.name!r}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix.lower() == ".gif":
            return _write_gif(list(frames), path, fps)
        return _write_mp4(frames, path, fps)
    except OSError as error:
        raise ResultsError(f"cannot write {path} ({error}): check the folder and the space left") from error


def _frames(
    results: Results, episode: EpisodeResult, world: GridMap, settings: EvaluationSettings, width: int
) -> Iterator[Image.Image]:
    mapping = settings.mapping.model_copy(update={"sensor_range": results.sensor_range_m})
    navigation = find_task(results.task).needs_target
    moments = retrace(world, episode.waypoints, mapping, settings.simulator, navigation=navigation)
    stage: _Stage | None = None
    picture: Image.Image | None = None
    for moment in moments:
        route = list(episode.waypoints[: moment.number + 1])
        if stage is not None:
            before, after = np.array(route[-2]), np.array(route[-1])
            for k in range(1, FRAMES_PER_STEP):
                x, y = before + (after - before) * k / FRAMES_PER_STEP
                yield stage.draw([*route[:-1], (float(x), float(y))])
        stage = _Stage(results.planner, world, moment, width, navigation)
        picture = stage.draw(route)
        yield picture
    for _ in range(HOLD_LAST):
        assert picture is not None
        yield picture


class _Stage:
    """What is known at one moment, as the background of the pictures until the next one."""

    def __init__(self, planner: str, world: GridMap, moment: Moment, width: int, navigation: bool) -> None:
        cells = belief_picture(moment.mapper.belief, world)
        rows, columns = cells.shape[:2]
        # Video codecs want even sides.
        self._scale = width / columns
        size = (width // 2 * 2, round(rows * self._scale) // 2 * 2)
        for x, y in moment.mapper.frontiers.tolist():
            column, row = to_pixels(world, (x, y))
            cells[min(max(round(row), 0), rows - 1), min(max(round(column), 0), columns - 1)] = _FRONTIER
        scaled = Image.fromarray(cells).resize(
            size, Image.Resampling.BOX if self._scale < 1 else Image.Resampling.NEAREST
        )
        self._background = Image.new("RGB", (size[0], size[1] + STRIP), (255, 255, 255))
        self._background.paste(scaled, (0, STRIP))
        pen = ImageDraw.Draw(self._background)
        words = f"{planner}   step {moment.number}   {moment.distance:.0f} m   {moment.coverage.explored:.1%} explored"
        pen.text((6, 5), words, fill=_TEXT)
        beacons = [] if moment.mapper.stuck else moment.mapper.beacons.tolist()
        for x, y in beacons:
            column, row = self._at(to_pixels(world, (x, y)))
            pen.polygon([(column, row - 6), (column - 5, row + 4), (column + 5, row + 4)], fill=_BEACON)
        if navigation and world.target is not None:
            column, row = self._at(to_pixels(world, world.target))
            pen.ellipse((column - 6, row - 6, column + 6, row + 6), outline=_TARGET, width=3)

    def draw(self, route: list[Position]) -> Image.Image:
        """Return a picture with the route so far and the robot at its end."""
        picture = self._background.copy()
        pen = ImageDraw.Draw(picture)
        points = [self._at(waypoint) for waypoint in route]
        if len(points) > 1:
            pen.line(points, fill=_ROUTE, width=2)
        x, y = points[-1]
        pen.ellipse((x - 5, y - 5, x + 5, y + 5), fill=_ROBOT, outline=(255, 255, 255))
        return picture

    def _at(self, pixel: Position) -> Position:
        return (pixel[0] + 0.5) * self._scale, (pixel[1] + 0.5) * self._scale + STRIP


def _write_gif(frames: list[Image.Image], path: Path, fps: int) -> int:
    # One palette for all pictures, made of the last one, which shows every colour.
    palette = frames[-1].quantize(64)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    small[0].save(path, save_all=True, append_images=small[1:], duration=round(1000 / fps), loop=0, optimize=True)
    return len(frames)


def _write_mp4(frames: Iterator[Image.Image], path: Path, fps: int) -> int:
    with optional("an MP4 video", "plots", instead="write a .gif"):
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401 - imageio finds it by itself, but says less when it is missing

    count = 0
    writer: Any = imageio.get_writer(path, fps=fps, codec="libx264", macro_block_size=2, ffmpeg_log_level="error")
    with writer:
        for frame in frames:
            pixels: NDArray[np.uint8] = np.asarray(frame)
            writer.append_data(pixels)
            count += 1
    return count
