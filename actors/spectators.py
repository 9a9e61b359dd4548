"""What people see of an actor's episodes: a few pictures a second while somebody looks, nothing otherwise."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.driver import Choice, Driver
from actors.environment import Environment
from common.bus.views import ViewPublisher
from common.messages.experience import End
from common.messages.places import viewpoint_kinds
from common.messages.view import MAX_CELLS, MAX_EDGES, MAX_PLACES, MAX_VIEWPOINTS, EpisodeView, Places
from common.system.printable import printable
from common.system.threads import Complaints

VIEW_SECONDS: Final = 0.25
"""At least between two views of a running episode."""
_NOWHERE: Final = np.empty((0, 2), np.float32)


class Spectators:
    """Shows episodes to whoever looks; a `Spectator`.

    Nobody looking costs a comparison of the clock for each decision. What fails here is logged and ends no episode.

    Args:
        actor: name of the actor.
        publisher: where the views go.
        clock: monotonic seconds.
    """

    def __init__(self, actor: str, publisher: ViewPublisher, clock: Callable[[], float] = time.monotonic) -> None:
        self._actor = actor
        self._publisher = publisher
        self._clock = clock
        self._due = float("-inf")
        self._complaints = Complaints("showing the episode")

    def __call__(self, family: str, environment: Environment, driver: Driver, choice: Choice | None) -> None:
        """Show a decision when it is time for a view, and the end of an episode to those who want outcomes."""
        with self._complaints:
            now = self._clock()
            if now >= self._due:
                self._due = now + VIEW_SECONDS
                if self._publisher.looked_at:
                    self._publisher.send(view_of(self._actor, family, environment, driver, choice))
            if choice is None and self._publisher.outcomes_wanted:
                self._publisher.send(view_of(self._actor, family, environment, driver, None), outcome=True)


def view_of(actor: str, family: str, environment: Environment, driver: Driver, choice: Choice | None) -> EpisodeView:
    """Return what there is to see of an episode.

    Args:
        actor: name of the actor.
        family: name of the family of worlds.
        environment: at a decision, or at its end.
        driver: who chooses.
        choice: what it chose; None at the end.
    """
    mapper, belief = environment.mapper, environment.mapper.belief
    cells, resolution = _bounded(belief.cells, belief.resolution)
    viewpoints = mapper.viewpoints[:MAX_VIEWPOINTS]
    kinds, edges, beacons = np.zeros(len(viewpoints), np.uint8), np.empty((0, 2), np.int64), _NOWHERE
    if not mapper.stuck:
        kinds = viewpoint_kinds(mapper.observe())[: len(viewpoints)]
        pairs = mapper.edges
        edges = pairs[pairs[:, 1] < len(viewpoints)][:MAX_EDGES]
        beacons = _places(mapper.beacons)
    return EpisodeView(
        actor=actor,
        family=family,
        world=printable(environment.world.name)[:256],
        task=environment.goal.task.name,
        driver=driver.name,
        version=driver.version,
        step=environment.steps,
        distance=environment.distance,
        explored=environment.coverage.explored,
        ended=environment.end is not End.NONE,
        success=environment.success,
        resolution=resolution,
        origin=belief.origin,
        cells=cells,
        viewpoints=viewpoints.astype(np.float32),
        kinds=kinds,
        edges=edges.astype(np.uint16),
        frontiers=_places(mapper.frontiers),
        beacons=beacons,
        way=_places(np.array(environment.positions)),
        beacon=_NOWHERE if choice is None else _places(np.array([mapper.position(choice.beacon)])),
        waypoint=_NOWHERE if choice is None else _places(np.array([mapper.position(choice.waypoint)])),
        target=_NOWHERE if mapper.target is None else _places(np.array([mapper.target])),
    )


def _places(found: NDArray[np.float64]) -> Places:
    """Return positions, evenly thinned where there are too many; the last one stays."""
    step = -(-len(found) // MAX_PLACES) or 1
    return found[::-1][::step][::-1].astype(np.float32).reshape(-1, 2)


def _bounded(cells: NDArray[np.int8], resolution: float) -> tuple[NDArray[np.int8], float]:
    """Return a belief coarse enough for a view: of four cells a wall wins, then what is free."""
    while cells.size > MAX_CELLS:
        rows, columns = cells.shape
        padded = np.pad(cells, ((0, rows % 2), (0, columns % 2)), constant_values=-1)
        cells = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2).max(axis=(1, 3))
        resolution *= 2.0
    return cells, resolution
