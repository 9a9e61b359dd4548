"""Transforms between frames, as /tf and /tf_static carry them: 3D rotations, chains, interpolation in time."""

from __future__ import annotations

from bisect import bisect_left
from math import isfinite
from typing import Final

from common.errors import MappingError
from deploy.tf.transform import Quaternion, Transform, Vector, differ, interpolated

# Frames that a message names at most.
_SHOWN: Final = 12
# A frame that comes back so soon to the parent that it had, seconds, has two publishers.
_BY_TURNS: Final = 1.0


class _Link:
    """Where one frame lay in its parent over the last seconds."""

    def __init__(self, parent: str, static: bool) -> None:
        self.parent = parent
        self.static = static
        self.moved = float("-inf")
        self.times: list[float] = []
        self.transforms: list[Transform] = []

    def add(self, time: float, transform: Transform, seconds: float) -> None:
        if self.static:
            self.times, self.transforms = [time], [transform]
            return
        if self.times and differ(self.transforms[-1], transform):
            self.moved = time
        if self.times and time < self.times[-1] - seconds:
            self.times.clear()
            self.transforms.clear()
        at = bisect_left(self.times, time)
        if at < len(self.times) and self.times[at] == time:
            self.transforms[at] = transform
            return
        self.times.insert(at, time)
        self.transforms.insert(at, transform)
        outdated = bisect_left(self.times, self.times[-1] - seconds)
        if outdated > 100:
            del self.times[:outdated], self.transforms[:outdated]

    def at(self, time: float, hold: float) -> Transform | None:
        if self.static:
            return self.transforms[-1]
        times, at = self.times, bisect_left(self.times, time)
        if at < len(times) and times[at] == time:
            return self.transforms[at]
        before = time - times[at - 1] if at > 0 else float("inf")
        after = times[at] - time if at < len(times) else float("inf")
        if min(before, after) > hold:
            return None
        if before + after > 2.0 * hold:
            return self.transforms[at - 1 if before <= after else at]
        return interpolated(self.transforms[at - 1], self.transforms[at], before / (before + after))


class TransformTree:
    """The frames of the robot and where they lie in each other; not thread-safe.

    Each frame has one parent. Links of /tf move and are kept for some seconds; those of /tf_static stand still. A link
    is held beyond its newest transform for ``hold`` seconds; for the first moving link above the frame that is asked
    for (odom -> base) each question gives a tighter limit. So a SLAM that corrects map -> odom once a second does not
    delay the scans that odom -> base places ten times a second.
    """

    def __init__(self, seconds: float = 10.0, hold: float = 5.0) -> None:
        """Keep moving links for ``seconds`` and hold each one for ``hold`` seconds beyond its newest transform."""
        self._seconds = seconds
        self.hold: Final = hold
        self._links: dict[str, _Link] = {}
        self._left: dict[str, tuple[str, float]] = {}
        self._contested: tuple[str, float, str] | None = None
        self._changed = ""

    def add(
        self, time: float, parent: str, child: str, translation: Vector, rotation: Quaternion, *, static: bool = False
    ) -> None:
        """Add where a frame lies in its parent.

        A frame that is given another parent moves there with all that hangs on it.

        Raises:
            MappingError: the numbers are no transform, or the frames would form a ring.
        """
        parent, child = parent.lstrip("/"), child.lstrip("/")
        try:
            transform = Transform.checked(translation, rotation)
        except MappingError as error:
            raise MappingError(f"{parent} -> {child}: {error}") from None
        if not isfinite(time):
            raise MappingError(f"a transform needs a finite stamp, got {time}: correct its publisher")
        above: str | None = parent
        while above is not None:
            if above == child:
                raise MappingError(
                    f"frame {child!r} cannot hang on {parent!r}, which hangs on {child!r} itself: two publishers "
                    "disagree about the tree; stop one of them"
                )
            link = self._links.get(above)
            above = None if link is None else link.parent
        link = self._links.get(child)
        if link is None or link.parent != parent or link.static != static:
            if link is not None:
                self._look_for_turns(child, parent, link.parent, time)
            link = self._links[child] = _Link(parent, static)
        if static and link.times and differ(link.transforms[-1], transform):
            self._changed = (
                f"the static transform {parent} -> {child} changed from {link.transforms[-1].text} to "
                f"{transform.text}: stop one of two publishers that disagree, or reset the map if the frame was moved"
            )
        link.add(time, transform, self._seconds)

    @property
    def changed(self) -> str:
        """Which static transform was published with other numbers last, in words; empty when none was."""
        return self._changed

    def _look_for_turns(self, child: str, parent: str, before: str, time: float) -> None:
        left, when = self._left.get(child, ("", 0.0))
        if left == parent and abs(time - when) <= _BY_TURNS:
            both = " and ".join(map(repr, sorted({before, parent})))
            where = both if before != parent else f"{both} on both /tf and /tf_static"
            self._contested = (
                child,
                time,
                f"frame {child!r} hangs by turns on {where}: two publishers disagree about the tree, and neither's "
                "transforms can be relied on; stop one of them",
            )
        self._left[child] = before, time

    @property
    def contested(self) -> str:
        """Which frame has had two parents by turns of late, in words with a remedy; empty when none has."""
        if self._contested is None:
            return ""
        child, when, words = self._contested
        link = self._links.get(child)
        return words if link is not None and abs(link.times[-1] - when) <= self._seconds else ""

    def forget_moving(self) -> None:
        """Forget all transforms of /tf; those of /tf_static stay."""
        self._links = {child: link for child, link in self._links.items() if link.static}

    def knows(self, frame: str) -> bool:
        """Whether a frame is in the tree."""
        frame = frame.lstrip("/")
        return frame in self._links or any(link.parent == frame for link in self._links.values())

    def stays_behind(self, frame: str, base: str) -> bool | None:
        """Whether a frame stays where it is when the base moves, as that of a map does.

        Returns:
            None when the two are not connected.
        """
        path = self._path(frame.lstrip("/"), base.lstrip("/"))
        return None if path is None else self._first_moving(path[0]) is not None

    def gap(self, target: str, source: str) -> str:
        """Say what is lacking between two frames that are not connected, one line without a remedy."""
        target, source = target.lstrip("/"), source.lstrip("/")
        for frame in (source, target):
            if not self.knows(frame):
                names = sorted({*self._links, *(link.parent for link in self._links.values())})
                more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
                return f"TF has no frame {frame!r} but {', '.join(repr(name) for name in names[:_SHOWN])}{more}"
        tops = [source, target]
        for number in range(len(tops)):
            while tops[number] in self._links:
                tops[number] = self._links[tops[number]].parent
        return f"TF leads from {source!r} up to {tops[0]!r}, and from {target!r} up to {tops[1]!r}, without a link"

    def outdated(self, target: str, source: str, time: float) -> str:
        """Say which link between two connected frames does not tell of a time, though `hold` is long; or empty."""
        for frame in (frame for frames in self._path(target.lstrip("/"), source.lstrip("/")) or () for frame in frames):
            link = self._links[frame]
            if link.at(time, self.hold) is None:
                nearest = min(link.times, key=lambda each: abs(each - time))
                return f"the transform {link.parent} -> {frame} is stamped {nearest:.3f} s"
        return ""

    def joint_behind(self, target: str, source: str, time: float, *, new: bool) -> tuple[str, float] | None:
        """Return a link between two frames that moved within ``hold`` seconds, and does not tell of a time yet.

        Parts that stand still are published on /tf, too, as seldom as somebody likes; of one transform alone nobody
        knows whether it is of such a part, and it counts as moved where that is asked for (``new``).

        Returns:
            Its frames in words and its newest stamp, seconds; None without.
        """
        for frame in (frame for frames in self._path(target.lstrip("/"), source.lstrip("/")) or () for frame in frames):
            link = self._links[frame]
            moved = time <= link.moved + self.hold or (new and not link.static and len(link.times) == 1)
            if moved and link.times[-1] < time:
                return f"{link.parent} -> {frame}", link.times[-1]
        return None

    def newest(self, target: str, source: str) -> float | None:
        """Return the newest stamp of the first moving link above the source.

        Returns:
            Infinity when only static links lead to the target, None when the two frames are not connected.
        """
        path = self._path(target.lstrip("/"), source.lstrip("/"))
        if path is None:
            return None
        moving = self._first_moving(path[0])
        return float("inf") if moving is None else self._links[moving].times[-1]

    def carrier(self, target: str, source: str) -> str | None:
        """Return the child frame of the first moving link above the source, whose transforms tell where that is.

        Returns:
            The source itself, or what it is fixed to, such as base_footprint for base_link; None when the target and
            the source are not connected, or do not move.
        """
        path = self._path(target.lstrip("/"), source.lstrip("/"))
        return None if path is None else self._first_moving(path[0])

    def carries(self, target: str, source: str, frame: str) -> bool:
        """Whether a frame's own link lies between two connected frames, such as map -> odom for map and base_link."""
        path = self._path(target.lstrip("/"), source.lstrip("/"))
        return path is not None and (frame.lstrip("/") in path[0] or frame.lstrip("/") in path[1])

    def lookup(self, target: str, source: str, time: float, tolerance: float) -> Transform | None:
        """Return where the source frame lies in the target frame at a time.

        Args:
            target: such as ``map``.
            source: such as ``base_link``.
            time: seconds of the robot's clock.
            tolerance: how far the first moving link above the source is held beyond its ends, seconds.

        Returns:
            None when the frames are not connected, or a link does not tell of that time.
        """
        target, source = target.lstrip("/"), source.lstrip("/")
        path = self._path(target, source)
        if path is None:
            return None
        up, down = path
        tight = self._first_moving(up)
        result = Transform()
        for frame in up:
            link = self._links[frame].at(time, tolerance if frame == tight else self.hold)
            if link is None:
                return None
            result = link @ result
        back = Transform()
        for frame in down:
            link = self._links[frame].at(time, self.hold)
            if link is None:
                return None
            back = link @ back
        return back.inverse() @ result

    def _first_moving(self, frames: list[str]) -> str | None:
        return next((frame for frame in frames if not self._links[frame].static), None)

    def _path(self, target: str, source: str) -> tuple[list[str], list[str]] | None:
        """Return the frames whose links lead from the source and from the target up to what both hang on."""
        chains = []
        for frame in (source, target):
            chain = [frame]
            while chain[-1] in self._links:
                chain.append(self._links[chain[-1]].parent)
            chains.append(chain)
        common = next((frame for frame in chains[0] if frame in chains[1]), None)
        if common is None:
            return None
        return chains[0][: chains[0].index(common)], chains[1][: chains[1].index(common)]
