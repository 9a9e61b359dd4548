"""The replay buffer: sequences of ragged observations, each stored once, sampled as transitions."""

from __future__ import annotations

import threading
from collections import deque

import numpy as np
from numpy.typing import NDArray

from common.messages.experience import Chunk, Delivery, End
from learner.algorithm.batch import TransitionBatch
from learner.replay.links import TransitionLinks
from learner.replay.ragged import RaggedParts
from learner.replay.store import ObservationStore
from learner.replay.transitions import make_batch

Source = tuple[str, int, int]
"""(actor, incarnation, sequence) of a delivery."""


class ReplayBuffer:
    """A first-in-first-out buffer of transitions, bounded in number and in bytes; safe between threads.

    An observation is stored once: a transition is a step whose successor is here as well. Within a chunk the
    successor is the next row; across chunks the two are joined as soon as both are here, in whatever order they came.
    The last step of an actor that died stays without a successor: it is no transition, but serves imitation when an
    expert labelled it. What is evicted depends on the order of arrival alone, so the same deliveries rebuild the
    same buffer.

    Usage::

        replay = ReplayBuffer(capacity=100_000, max_bytes=500_000_000)
        replay.add(delivery)
        batch = replay.sample(64, np.random.default_rng(0))

    Args:
        capacity: transitions held at most.
        max_bytes: memory held at most.
        images: every observation that comes has an image; otherwise none has.
        hints: all labels that come have hints; otherwise none has.
    """

    def __init__(self, capacity: int, max_bytes: int, *, images: bool = False, hints: bool = False) -> None:
        self.capacity = capacity
        self.max_bytes = max_bytes
        self._lock = threading.Lock()
        self._store = ObservationStore(capacity, max_bytes, images=images, hints=hints)
        self._slots = self._store.slots
        self._columns = self._store.columns
        # Arrival numbers count for ever: the observations here are those from _oldest to _next - 1.
        self._oldest = 0
        self._next = 0
        # Where the observations here came from: (actor, incarnation, sequence) of deliveries in the order of arrival.
        self._sources: deque[Source] = deque()
        self._first_source = 0
        self._links = TransitionLinks(self._columns, self._slots)

    def __len__(self) -> int:
        """Number of transitions that can be sampled."""
        return self._links.count

    @property
    def fill(self) -> float:
        """Share of the capacity in use, by transitions or by bytes, whichever is nearer to its limit; 0 to 1."""
        by_bytes = self._store.live_bytes / self._store.ring_bytes
        return min(1.0, max(self._links.count / self.capacity, by_bytes))

    @property
    def bytes(self) -> int:
        """Memory in use, bytes."""
        return self._store.live_bytes + min(self._next, self._slots) * self._store.slot_bytes

    @property
    def observations(self) -> int:
        """Number of observations held."""
        return self._next - self._oldest

    @property
    def arrivals(self) -> tuple[int, int]:
        """Arrival numbers of the oldest observation here and of the next one to come."""
        with self._lock:
            return self._oldest, self._next

    def add(self, delivery: Delivery) -> int:
        """Store the chunk of a delivery and return its number of steps; reports of episodes are no experience.

        The caller delivers each chunk once and has validated it.
        """
        chunk = delivery.body
        if not isinstance(chunk, Chunk):
            return 0
        with self._lock:
            self._sources.append((delivery.actor, delivery.incarnation, delivery.sequence))
            first = self._store_observations(chunk)
            self._store_steps(chunk, first)
            self._links.join_chunk(delivery, chunk, first, self._oldest)
            while self._links.count > self.capacity:
                self._evict()
        return chunk.steps

    def sample(
        self,
        batch_size: int,
        rng: np.random.Generator,
        *,
        steps: int = 1,
        gamma: float = 0.99,
        labelled: bool = False,
        newest: int | None = None,
        rehearsed: int = 0,
    ) -> TransitionBatch:
        """Draw transitions uniformly with replacement.

        Args:
            batch_size: how many.
            rng: source of chance.
            steps: rewards that are summed; fewer where the episode ends or its next step is not here.
            gamma: discount factor.
            labelled: only transitions that an expert labelled, with the labels of both observations.
            newest: only so many that arrived last; None for all.
            rehearsed: so many of the batch, its last ones, are drawn from all labelled steps instead. They serve
                imitation alone, so their probability counts as 0.

        Raises:
            ValueError: when the buffer holds no such transition.
        """
        with self._lock:
            candidates = self._columns.successor >= 0
            if labelled:
                candidates &= self._columns.labelled
            what = "labelled transition" if labelled else "transition"
            drawn = self._draw(candidates, batch_size - rehearsed, rng, what, newest)
            if rehearsed:
                again = self._draw(self._columns.labelled, rehearsed, rng, "labelled step")
                drawn = np.concatenate([drawn, again])
            batch = make_batch(self._store, drawn, self._oldest, steps, gamma, judged=labelled)
        batch.probabilities[batch_size - rehearsed :] = 0.0
        return batch

    def sample_labelled(self, batch_size: int, rng: np.random.Generator) -> TransitionBatch:
        """Draw steps that an expert labelled, uniformly with replacement; their successor may be unknown.

        Raises:
            ValueError: when the buffer holds no labelled step.
        """
        with self._lock:
            rows = self._draw(self._columns.labelled, batch_size, rng, "labelled step")
            return make_batch(self._store, rows, self._oldest, steps=1, gamma=1.0, judged=False)

    def set_aside(self, arrivals: NDArray[np.int64]) -> list[Source]:
        """Never draw the steps of some deliveries again; return where those came from.

        Args:
            arrivals: arrival numbers of observations, one or more of each delivery; those that are gone do not count.
        """
        with self._lock:
            here = arrivals[(arrivals >= self._oldest) & (arrivals < self._next)]
            numbers = np.unique(self._columns.delivery[here % self._slots])
            held = np.arange(self._oldest, self._next)
            for number in held[np.isin(self._columns.delivery[held % self._slots], numbers)].tolist():
                self._withdraw(number)
            return [self._sources[number - self._first_source] for number in numbers.tolist()]

    @property
    def labelled(self) -> int:
        """Number of labelled steps."""
        with self._lock:
            return int(np.count_nonzero(self._columns.labelled[: min(self._next, self._slots)]))

    @property
    def labelled_transitions(self) -> int:
        """Number of labelled steps whose successor is here."""
        with self._lock:
            columns, held = self._columns, min(self._next, self._slots)
            return int(np.count_nonzero(columns.labelled[:held] & (columns.successor[:held] >= 0)))

    def versions(self) -> NDArray[np.int64]:
        """Return the policy version behind every step held, oldest first."""
        with self._lock:
            rows = np.arange(self._oldest, self._next) % self._slots
            return self._columns.version[rows[self._columns.step[rows]]]

    # --- storing -----------------------------------------------------------------------------------------------

    def _store_observations(self, chunk: Chunk) -> int:
        """Append all observations of a chunk, with their labels; return the arrival number of the first."""
        first_arrival = self._next
        ragged = RaggedParts.of(chunk, hints=self._store.hints)
        count = len(chunk.observations)
        if self._store.takes_whole(ragged):
            self._store_piece(chunk, ragged, 0, count)
        else:
            for i in range(count):
                self._store_piece(chunk, ragged, i, i + 1)
        return first_arrival

    def _store_piece(self, chunk: Chunk, ragged: RaggedParts, low: int, high: int) -> None:
        """Append observations ``low`` to ``high - 1``, after making room for them."""
        count, store = high - low, self._store
        size = store.size(ragged, low, high)
        while store.live_bytes + size > store.ring_bytes or self.observations + count > self._slots:
            self._evict()
        rows = store.write(chunk.observations, ragged, low, high, self._next)
        columns = self._columns
        columns.delivery[rows] = self._last_source
        columns.step[rows] = False
        self._links.clear(rows)
        columns.terminal[rows] = False
        columns.labelled[rows] = False
        self._next += count

    def _store_steps(self, chunk: Chunk, first: int) -> None:
        """Write actions, rewards and the expert's beacons; join each step to its successor within the chunk."""
        kept = max(first, self._oldest)  # a chunk larger than the buffer has lost its first observations already
        skip = kept - first
        steps = chunk.steps
        if skip >= steps:
            return
        columns = self._columns
        numbers = np.arange(kept, first + steps)
        rows = numbers % self._slots
        columns.step[rows] = True
        columns.beacon[rows] = chunk.beacons[skip:]
        columns.waypoint[rows] = chunk.waypoints[skip:]
        columns.reward[rows] = chunk.rewards[skip:]
        columns.version[rows] = chunk.versions[skip:]
        columns.probability[rows] = chunk.probabilities[skip:]
        columns.family[rows] = chunk.family
        self._links.join_to_next(numbers[numbers + 1 < first + len(chunk.observations)])
        if chunk.end is End.TERMINAL:
            columns.terminal[rows[-1]] = True
        if chunk.labels is not None:
            columns.labelled[rows] = True
            columns.first_beacon[rows] = chunk.labels.beacon[skip:]
            columns.remaining[rows] = chunk.labels.remaining[skip:]
            columns.unseen[rows] = chunk.labels.unseen[skip:]

    def _withdraw(self, number: int) -> None:
        """Let an observation stay where it is, but start no transition; sums of rewards end before it."""
        self._columns.labelled[number % self._slots] = False
        self._links.cut_after(number)

    def _evict(self) -> None:
        """Forget the oldest observation, and with it the transition that starts or ends there."""
        number, columns = self._oldest, self._columns
        row = number % self._slots
        self._links.evict(number)
        columns.labelled[row] = False
        self._store.free(row)
        self._oldest += 1
        # The delivery that is being stored may be so large that it evicts its own beginning.
        held = int(columns.delivery[self._oldest % self._slots]) if self._oldest < self._next else self._last_source
        while self._first_source < min(held, self._last_source):
            self._sources.popleft()
            self._first_source += 1

    @property
    def _last_source(self) -> int:
        """Number of the newest delivery."""
        return self._first_source + len(self._sources) - 1

    # --- sampling ----------------------------------------------------------------------------------------------

    def _draw(
        self,
        candidates: NDArray[np.bool_],
        batch_size: int,
        rng: np.random.Generator,
        what: str,
        newest: int | None = None,
    ) -> NDArray[np.int64]:
        rows = np.flatnonzero(candidates[: min(self._next, self._slots)])
        if len(rows) == 0:
            raise ValueError(f"the replay buffer holds no {what} yet: wait for the actors")
        # Rows are counted from the oldest, so that the draw does not depend on where the ring stands.
        shift = int(np.searchsorted(rows, self._oldest % self._slots))
        older = 0 if newest is None else max(len(rows) - newest, 0)
        return rows[(rng.integers(older, len(rows), size=batch_size) + shift) % len(rows)]
