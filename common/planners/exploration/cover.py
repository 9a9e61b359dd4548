"""Choosing viewpoints that together observe all frontiers: greedy set cover, randomised or not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def sample_cover(
    seen: NDArray[np.bool_], random: np.random.Generator | None, *, min_gain: int, choices: int = 1
) -> list[int]:
    """Choose viewpoints one after the other until none adds enough (Cao et al. 2021, algorithm 1).

    The gain of a viewpoint is the number of points that it sees and that no viewpoint chosen before sees: it only
    falls while viewpoints are added, so taking the best one each time is near the best cover, and taking one of the
    best at random gives other covers nearly as good, of which one may have a shorter tour.

    Args:
        seen: which viewpoint sees which point, bool, shape (viewpoints, points).
        random: source of chance; None takes the best one each time.
        min_gain: points that a viewpoint must add to be chosen, at least 1.
        choices: one of so many best viewpoints is taken each time, with a probability in proportion to its gain.

    Returns:
        Rows of `seen` in the order of choice.
    """
    cover: list[int] = []
    gains = seen.sum(axis=1)
    left = np.ones(seen.shape[1], dtype=np.bool_)
    while len(gains):
        best = np.argsort(-gains, kind="stable")[:choices]
        best = best[gains[best] >= min_gain]
        if not len(best):
            break
        pick = int(best[0])
        if random is not None:
            share = np.cumsum(gains[best])
            pick = int(best[np.searchsorted(share, random.random() * share[-1], side="right")])
        cover.append(pick)
        gone = np.flatnonzero(seen[pick] & left)
        left[gone] = False
        gains = gains - seen[:, gone].sum(axis=1)
    return cover


def subspace_stops(seen: NDArray[np.bool_], places: NDArray[np.float64], side: float, min_gain: int) -> list[int]:
    """Choose one viewpoint for each subspace that has something left to explore.

    Subspaces are the squares of a fixed grid. They are taken in the order of what they add, so that frontiers which
    two subspaces see count once; a subspace is represented by its viewpoint that sees most. Viewpoints that see less
    than `min_gain` do not count together either: on the spot none of them would be chosen (see `sample_cover`), so a
    subspace that only their sum made worth a visit would draw the robot near and vanish there, again and again.

    Args:
        seen: which viewpoint sees which point, bool, shape (viewpoints, points).
        places: of the viewpoints, metres, shape (viewpoints, 2).
        side: of a subspace, metres.
        min_gain: points that a subspace must add, and that its viewpoint must see.

    Returns:
        Rows of `seen`.
    """
    counts = seen.sum(axis=1)
    members: dict[tuple[int, int], list[int]] = {}
    for row, (x, y) in enumerate(np.floor(places / side).astype(np.int64).tolist()):
        if counts[row] >= min_gain:
            members.setdefault((x, y), []).append(row)
    groups = list(members.values())
    if not groups:
        return []
    together = np.array([seen[group].any(axis=0) for group in groups])
    return [groups[k][int(np.argmax(counts[groups[k]]))] for k in sample_cover(together, None, min_gain=min_gain)]
