"""By which numbers a planar lidar says that a beam met nothing: infinity is one of several."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from common.geometry import Scan
from common.mapping.belief import RANGE_TOLERANCE

NoReturn = float | Literal["nan"] | None
"""Number that a lidar gives for nothing met, metres, where that is neither infinite nor at least its range_max."""

# No wall has so many beams of the same length to the last bit, over so wide an angle (radians).
_FEWEST_EQUAL: Final = 8
_WIDE: Final = 0.2
# Such beams end at the limit of the sensor where they have at least this share of its range_max.
_AT_THE_LIMIT: Final = 0.97
# Equal readings elsewhere are worth a word over so wide an angle, where not many are longer (quantile), and invalid
# ones in such a share of the beams.
_WIDER: Final = 0.5
_LONG: Final = 0.95
_MANY: Final = 0.25


def understood(scan: Scan, no_return: NoReturn) -> tuple[Scan, str]:
    """Return a scan in which what met nothing is at or above range_max, and what is strange about its numbers.

    Where readings just below range_max are the same to the last bit over a wide angle, they are the sensor's limit and
    no wall: range_max is lowered to them. Other equal readings are taken as they are, and named.

    Args:
        scan: as it came.
        no_return: what the configuration says.

    Returns:
        The note is empty when nothing is strange.
    """
    if isinstance(no_return, float) and scan.range_min <= no_return < scan.range_max:
        # Such a lidar tells nothing of what is farther.
        scan = replace(scan, range_max=no_return)
    elif no_return is not None:
        none = np.isnan(scan.ranges) if no_return == "nan" else scan.ranges == np.float32(no_return)
        scan = replace(scan, ranges=np.where(none, np.float32(np.inf), scan.ranges))
    told = scan.ranges[(scan.ranges >= scan.range_min) & (scan.ranges < scan.range_max - RANGE_TOLERANCE)]
    common = _most_common(told[told >= _AT_THE_LIMIT * scan.range_max])
    if common is not None and common[1] * abs(scan.angle_increment) >= _WIDE and common[1] >= _FEWEST_EQUAL:
        scan = replace(scan, range_max=common[0])
    # Parts of the robot may be seen alike, too, but other beams are longer then.
    note, common = "", _most_common(told[told >= np.quantile(told, _LONG)] if len(told) else told)
    if common is not None and common[1] * abs(scan.angle_increment) >= _WIDER and common[0] < scan.range_max:
        # Notes have no figures that differ from scan to scan: each is told once.
        note = (
            f"beams of a scan over a wide angle are all {common[0]:g} m, and its range_max is {scan.range_max:g} m: "
            f"where the lidar says so when it meets nothing, set {setting(common[0])}, or a wall is drawn there"
        )
    return scan, note or _invalid_note(scan)


def setting(value: float) -> str:
    """Return the setting by which a reading counts as nothing met."""
    return f"sensing.no_return={value:g}"


def common_invalid(scan: Scan) -> tuple[float, int] | None:
    """Return the most frequent number below range_min and how many beams have it; None where there is none."""
    return _most_common(scan.ranges[np.isfinite(scan.ranges) & (scan.ranges < max(scan.range_min, RANGE_TOLERANCE))])


def _most_common(ranges: NDArray[np.float32]) -> tuple[float, int] | None:
    if len(ranges) == 0:
        return None
    values, counts = np.unique(ranges, return_counts=True)
    most = int(counts.argmax())
    return float(values[most]), int(counts[most])


def _invalid_note(scan: Scan) -> str:
    common = common_invalid(scan)
    if common is None or common[1] < _MANY * len(scan.ranges):
        return ""
    value = common[0]
    return (
        f"more than {_MANY:.0%} of a scan's beams are {value:g}, which is below its range_min and tells nothing: where "
        f"the lidar says so when it meets nothing, set {setting(value)}, or open space stays unknown"
    )
