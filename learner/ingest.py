"""Ingest: what happens to a delivery before it is acknowledged, and how a resumed learner gets it all back."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from queue import Empty, SimpleQueue
from typing import Any

from common.bus.seen import SeenSet
from common.config.schema import RunConfig
from common.errors import CheckpointError, MessageError
from common.messages.experience import Chunk, Delivery, EpisodeReport
from common.messages.schema import decode, encode
from learner.ratio import RatioKeeper
from learner.replay.buffer import Replay
from learner.run.episodes import EpisodeLog, group_of
from learner.run.journal import Journal
from learner.run.records import RecordKind
from learner.watch.evaluation import EvaluationRounds, Round
from learner.watch.metrics import Means, RateMeter

logger = logging.getLogger(__name__)


@dataclass(slots=True)
class ActorRecord:
    """What the learner has received from one actor since this process started.

    Attributes:
        steps: stored decisions.
        episodes: finished episodes.
        version: policy version behind its newest step or episode.
        arrived: monotonic seconds of its newest delivery.
    """

    steps: int = 0
    episodes: int = 0
    version: int = -1
    arrived: float = 0.0


class Ingest:
    """Takes deliveries into journal, replay buffer and records, each exactly once.

    `store` is what the bus calls before it acknowledges; it never waits for training. `snapshot` and `rebuild` are the
    two halves of resuming: a checkpoint notes a place in the journal and all counts at that place, and a resumed
    learner reads the journal again: what lies before the place only fills the replay buffer, what lies behind it
    counts as it did the first time.

    Args:
        config: of the run.
        replay: the replay buffer.
        keeper: counts steps and tells how long actors should pause.
        journal: of the run.
        episodes: of the run.
    """

    def __init__(
        self, config: RunConfig, replay: Replay, keeper: RatioKeeper, journal: Journal, episodes: EpisodeLog
    ) -> None:
        self.replay = replay
        self.keeper = keeper
        self.episodes = episodes
        self.means = Means()
        self.steps_rate = RateMeter()
        self.actors: dict[str, ActorRecord] = {}
        self.version = 0
        """Newest published policy version."""
        self.episode_count = 0
        self.evaluated_at = float("-inf")
        """Monotonic seconds of the newest report of an evaluator."""
        self._keep_replay = config.checkpoints.replay
        self._journal = journal
        self._rounds = EvaluationRounds(config.maps.validation_count)
        self._finished_rounds: SimpleQueue[Round] = SimpleQueue()
        self._seen = SeenSet()
        self._raw: bytes | None = None
        # Last arrival number of the replay buffer that each journal segment holds.
        self._segment_ends: dict[int, int] = {}
        self._lock = threading.Lock()
        self._arrival = threading.Condition()

    def keep_raw(self, payload: bytes) -> None:
        """Take the bytes of the delivery that `store` is called with next, so that it need not encode it again."""
        self._raw = payload

    def store(self, delivery: Delivery) -> float:
        """Take one valid delivery; return the seconds that its actor should pause.

        A delivery that was stored before changes nothing.

        Raises:
            StorageError: when the journal cannot be written; nothing is stored then.
        """
        payload, self._raw = self._raw, None
        with self._lock:
            if (delivery.actor, delivery.incarnation, delivery.sequence) not in self._seen:
                segment = self._journal.segment
                self._journal.append(RecordKind.DELIVERY, encode(delivery) if payload is None else payload)
                self._take(delivery, segment)
                self._note_actor(delivery)
        with self._arrival:
            self._arrival.notify_all()
        return self.keeper.hold()

    def wait(self, ready: Callable[[], bool], timeout: float) -> bool:
        """Wait until ``ready`` holds, looking again with every delivery; return whether it does."""
        with self._arrival:
            return self._arrival.wait_for(ready, timeout)

    def wake(self) -> None:
        """Let `wait` look again, because something else than a delivery has changed."""
        with self._arrival:
            self._arrival.notify_all()

    def note_version(self, version: int) -> None:
        """Record that a policy version is about to be published, so that no later process reuses its number."""
        with self._lock:
            self._journal.append(RecordKind.VERSION, version.to_bytes(8, "little"))
            self.version = version

    def finished_rounds(self) -> list[Round]:
        """Return the rounds of evaluation that were completed since the last call."""
        rounds = []
        while True:
            try:
                rounds.append(self._finished_rounds.get_nowait())
            except Empty:
                return rounds

    @property
    def versions_under_evaluation(self) -> set[int]:
        """Policy versions whose round of evaluation has begun."""
        with self._lock:
            return self._rounds.versions

    @property
    def seen_state(self) -> dict[str, Any]:
        """What was stored so far, as the bus's server takes it over."""
        with self._lock:
            return self._seen.state()

    # --- checkpoints -------------------------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Note a place in the journal and all counts at that place, ready for JSON.

        Raises:
            StorageError: when the disk does not take what belongs before that place.
        """
        with self._lock:
            self.episodes.flush()
            return {
                "segment": self._journal.rotate(),
                "steps": self.keeper.steps,
                "episodes": self.episode_count,
                "episodes_length": self.episodes.length,
                "version": self.version,
                "seen": self._seen.state(),
                "rounds": self._rounds.state(),
            }

    def sync(self) -> None:
        """Bring journal and episodes up to the last snapshot onto the disk."""
        self._journal.sync()
        self.episodes.sync()

    def forget_before(self, segment: int) -> None:
        """Delete journal segments older than ``segment`` that the replay buffer holds nothing of."""
        with self._lock:
            oldest, _ = self.replay.arrivals
            if self._keep_replay:
                held = [number for number, end in self._segment_ends.items() if end > oldest]
                segment = min([segment, *held])
            self._journal.drop_before(segment)
            self._segment_ends = {number: end for number, end in self._segment_ends.items() if number >= segment}

    def rebuild(self, snapshot: dict[str, Any], updates: int) -> None:
        """Bring everything to where the last process left it.

        Args:
            snapshot: of the checkpoint that is resumed.
            updates: updates of that checkpoint.

        Raises:
            CheckpointError: when a segment of the journal behind the checkpoint is damaged or of another release.
        """
        began = time.monotonic()
        place = int(snapshot["segment"])
        self.keeper.restore(int(snapshot["steps"]), updates)
        self.episode_count = int(snapshot["episodes"])
        self.version = int(snapshot["version"])
        self._seen.restore(snapshot["seen"])
        self._rounds.restore(snapshot["rounds"])
        again = 0
        before = SeenSet()
        for segment in self._journal.segments():
            if segment == self._journal.segment or (segment < place and not self._keep_replay):
                continue
            try:
                again += self._read_segment(segment, place, before)
            except CheckpointError as error:
                if segment >= place:
                    raise
                logger.error("%s; the replay buffer goes on without the rest of it", error)
        if self._journal.losses and (missing := missing_deliveries(self._seen)):
            logger.error("deliveries that the damage has cost: %s", missing)
        fresh_from = 0 if self._keep_replay and len(self.replay) else int(snapshot["steps"])
        self.keeper.restore(self.keeper.steps, updates, len(self.replay), fresh_from)
        logger.info(
            "read the journal in %.1f s: %d transitions in the replay buffer, %d deliveries newer than the checkpoint",
            time.monotonic() - began,
            len(self.replay),
            again,
        )

    def _read_segment(self, segment: int, place: int, before: SeenSet) -> int:
        """Take over the records of one segment; return the number of deliveries that count."""
        counted = 0
        for record in self._journal.read_segment(segment):
            if record.kind is RecordKind.VERSION:
                self.version = max(self.version, int.from_bytes(record.payload, "little"))
                continue
            try:
                delivery = decode(record.payload, Delivery)
            except MessageError as error:
                raise CheckpointError(
                    f"journal segment {segment} holds a delivery that this software cannot read ({error}): "
                    "resume the run with the release that wrote it, or have `hd-learner doctor --repair` set it aside"
                ) from error
            key = (delivery.actor, delivery.incarnation, delivery.sequence)
            if segment < place:
                if before.add(*key):
                    self._fill(delivery, segment)
            elif key not in self._seen:
                self._take(delivery, segment)
                counted += 1
        return counted

    @property
    def nothing_yet(self) -> dict[str, Any]:
        """The snapshot of a run that has no checkpoint: all that its journal holds counts."""
        return {"segment": 0, "steps": 0, "episodes": 0, "version": 0, "seen": {"streams": []}, "rounds": []}

    # --- parts of storing --------------------------------------------------------------------------------------

    def _take(self, delivery: Delivery, segment: int) -> None:
        """Count a new delivery and keep what it holds."""
        steps = self._fill(delivery, segment)
        self.keeper.note_steps(steps, len(self.replay))
        if isinstance(delivery.body, EpisodeReport):
            self._note_episode(delivery, delivery.body)
        self._seen.add(delivery.actor, delivery.incarnation, delivery.sequence)

    def _fill(self, delivery: Delivery, segment: int) -> int:
        steps = self.replay.add(delivery)
        if steps:
            self._segment_ends[segment] = self.replay.arrivals[1]
        return steps

    def _note_episode(self, delivery: Delivery, report: EpisodeReport) -> None:
        self.episode_count += 1
        self.episodes.append(
            report,
            time=round(time.time(), 3),
            actor=delivery.actor,
            collected=self.keeper.steps,
            updates=self.keeper.updates,
        )
        if group_of(report) == "evaluate":
            self.evaluated_at = time.monotonic()
            done = self._rounds.add(delivery.actor, delivery.incarnation, report)
            if done is not None:
                self._finished_rounds.put(done)

    def _note_actor(self, delivery: Delivery) -> None:
        record = self.actors.setdefault(delivery.actor, ActorRecord())
        record.arrived = time.monotonic()
        body = delivery.body
        if isinstance(body, Chunk):
            record.steps += body.steps
            record.version = int(body.versions[-1])
            self.steps_rate.add(body.steps)
            self.means.add({"policy/lag_versions": float(self.version - body.versions.mean())})
        else:
            record.episodes += 1
            record.version = body.version


def missing_deliveries(seen: SeenSet) -> str:
    """Name the deliveries between others of the same actor that were never stored; empty when there are none."""
    gaps = []
    for (actor, incarnation), ranges in sorted(seen.streams().items()):
        missing = [f"{end} to {first - 1}" for (_, end), (first, _) in pairwise(ranges)]
        if missing:
            gaps.append(f"{actor} (incarnation {incarnation}) {', '.join(missing)}")
    return "; ".join(gaps)
