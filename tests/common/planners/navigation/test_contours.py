from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from common.mapping.sight import FREE, OCCUPIED
from common.planners.navigation.contours import convex_corners, thicken, trace

Mask = NDArray[np.bool_]


def drawn(rows: list[str]) -> Mask:
    """`#` is solid; the top row first; a free ring is added."""
    return np.pad(np.array([list(row) for row in rows])[::-1] == "#", 2)


def area(contour: NDArray[np.int32]) -> float:
    """Shoelace formula: above 0 for counter-clockwise contours."""
    x, y = contour.astype(np.int64).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


masks = st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(0, 2**32 - 1), st.floats(0.1, 0.9)).map(
    lambda t: np.pad(np.random.default_rng(t[2]).random((t[0], t[1])) < t[3], 2)
)


def thickened(occupied: Mask, before: Mask | None = None) -> Mask:
    """Thickened anew, or after a change from the cells before, within the box of what has changed."""
    solid = np.zeros(occupied.shape, dtype=np.bool_)
    everything = (0, occupied.shape[0] - 1, 0, occupied.shape[1] - 1)
    if before is None:
        thicken(np.where(occupied, OCCUPIED, FREE).astype(np.int8), solid, everything)
        return solid
    thicken(np.where(before, OCCUPIED, FREE).astype(np.int8), solid, everything)
    rows, columns = np.nonzero(occupied != before)
    if len(rows):
        box = (int(rows.min()), int(rows.max()), int(columns.min()), int(columns.max()))
        thicken(np.where(occupied, OCCUPIED, FREE).astype(np.int8), solid, box)
    return solid


@settings(max_examples=100, deadline=None)
@given(masks, st.integers(0, 2**32 - 1), st.floats(0.0, 0.5))
def test_what_is_thickened_follows_changes(occupied: Mask, seed: int, share: float) -> None:
    changed = np.zeros_like(occupied)
    changed[2:-2, 2:-2] = np.random.default_rng(seed).random(np.subtract(occupied.shape, 4)) < share
    after = occupied ^ changed
    expected = np.zeros_like(after)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            expected |= np.roll(after, (down, right), axis=(0, 1))
    assert np.array_equal(thickened(after, before=occupied), expected)
    assert np.array_equal(thickened(after), expected)


def test_a_rectangle_is_its_four_corners_counter_clockwise() -> None:
    (contour,) = trace(drawn(["###", "###"]))
    assert sorted(map(tuple, contour.tolist())) == [(2, 2), (2, 4), (5, 2), (5, 4)]
    assert area(contour) == 6.0


def test_a_ring_has_an_outer_border_and_a_hole() -> None:
    contours = trace(drawn(["###", "#.#", "###"]))
    assert sorted(area(c) for c in contours) == [-1.0, 9.0]


def test_cells_that_touch_in_a_corner_are_one_obstacle() -> None:
    contours = trace(drawn(["#.", ".#"]))
    assert len(contours) == 1
    assert area(contours[0]) == 2.0


def test_nothing_solid_has_no_border() -> None:
    assert trace(np.zeros((5, 5), dtype=np.bool_)) == []
    assert len(convex_corners(np.zeros((5, 5), dtype=np.bool_), 1.0)) == 0


@settings(max_examples=200, deadline=None)
@given(masks)
def test_borders_enclose_exactly_the_solid_cells(solid: Mask) -> None:
    contours = trace(solid)
    assert sum(area(c) for c in contours) == pytest.approx(float(solid.sum()))
    sides = 0
    for contour in contours:
        steps = np.roll(contour, -1, axis=0).astype(np.int64) - contour
        assert np.all((steps == 0).sum(axis=1) == 1)
        sides += int(np.abs(steps).sum())
    vertical = int(np.count_nonzero(solid[:, 1:] != solid[:, :-1]))
    horizontal = int(np.count_nonzero(solid[1:] != solid[:-1]))
    assert sides == vertical + horizontal


@settings(max_examples=100, deadline=None)
@given(masks)
def test_without_simplification_convex_corners_are_those_of_single_cells(solid: Mask) -> None:
    corners = convex_corners(solid, 0.0)
    for x, y, *_ in corners.tolist():
        around = solid[y - 1 : y + 1, x - 1 : x + 1]
        assert int(around.sum()) in (1, 2)
    # Each place with one solid cell of four is a convex corner.
    count = sum(
        int(solid[y - 1 : y + 1, x - 1 : x + 1].sum()) == 1
        for y in range(1, solid.shape[0])
        for x in range(1, solid.shape[1])
    )
    assert len({(x, y) for x, y, *_ in corners.tolist()}) >= count


def test_a_staircase_becomes_a_straight_side() -> None:
    n = 20
    solid = np.zeros((n + 4, n + 4), dtype=np.bool_)
    for k in range(n):
        solid[2 + k, 2 : 3 + k] = True
    assert len(convex_corners(solid, 0.0)) == n + 3
    # The corners of the triangle, two of them blunt.
    assert len(convex_corners(solid, 0.95)) <= 5


@settings(max_examples=100, deadline=None)
@given(masks)
def test_no_side_of_a_polygon_touches_what_was_thickened(occupied: Mask) -> None:
    """This is what makes visibility graphs of thickened obstacles safe."""
    solid = thickened(occupied)
    assert np.all(solid[occupied])
    rows, columns = np.nonzero(occupied)
    for x, y, before_x, before_y, after_x, after_y in convex_corners(solid, 0.95).tolist():
        for other_x, other_y in ((before_x, before_y), (after_x, after_y)):
            t = np.linspace(0.0, 1.0, 200)[:, None]
            points = np.array([x, y]) + t * (np.array([other_x, other_y]) - np.array([x, y]))
            inside = (
                (points[:, :1] >= columns)
                & (points[:, :1] <= columns + 1)
                & (points[:, 1:] >= rows)
                & (points[:, 1:] <= rows + 1)
            )
            assert not inside.any()
