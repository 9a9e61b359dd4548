"""Small open planes of which all is known: who sees what, and what a tour leaves unseen."""

import numpy as np

from actors.expert.visibility import look_from_all


def universe(seed, viewpoints=25, rows=20, columns=26):
    """A random open plane with pillars: who sees what, distances, and all cells that somebody sees."""
    rng = np.random.default_rng(seed)
    free = rng.random((rows, columns)) < 0.93
    cells = np.argwhere(free)
    chosen = cells[rng.choice(len(cells), viewpoints, replace=False)]
    points = np.ascontiguousarray(chosen[:, ::-1] + 0.5)
    sight = look_from_all(free, points, 6.0, 240)
    distances = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)).astype(np.float32)
    missing = np.zeros(sight.tiles, dtype=np.uint64)
    for k in range(len(sight.tile)):
        missing[sight.tile[k]] |= sight.mask[k]
    return free, points, sight, distances, missing


def uncovered(sight, missing, stops):
    rest = missing.copy()
    for v in stops:
        for k in range(sight.pointer[v], sight.pointer[v + 1]):
            rest[sight.tile[k]] &= ~sight.mask[k]
    return sum(int(word).bit_count() for word in rest)
