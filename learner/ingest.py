"""Ingest: what happens to a delivery before it is acknowledged, and how a resumed learner gets it all back."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any

from common.bus.keys import host_of
from common.bus.seen import SeenSet
from common.bus.tls import certified_hosts
from common.config import RunConfig
from common.errors import CheckpointError, MessageError
from common.messages.experience import Chunk, Delivery, EpisodeReport
from common.messages.schema import decode, describe_delivery, encode
from learner.admission import Admission
from learner.quarantine import Quarantine
from learner.rate_limiter import RateLimiter
from learner.replay.buffer import ReplayBuffer
from learner.run.episodes import EpisodeLog, group_of
from learner.run.evaluation import EvaluationRounds, Evaluators, Round
from learner.run.journal import Journal
from learner.run.records import RecordKind
from learner.run.repair import missing_deliveries
from learner.watch.actors import ActorRecords
from learner.watch.metrics import Means, RateMeter

logger = logging.getLogger(__name__)

# Messages of a journal that are named in the log; of the others there is the number.
_MAX_NAMED = 100


class Ingest:
    """Takes deliveries into journal, replay buffer and records, each exactly once.

    `store` is what the bus calls before it acknowledges; it never waits for training. `snapshot` and `rebuild` are the
    two halves of resuming: a checkpoint notes a place in the journal and all counts at that place, and a resumed
    learner reads the journal again: what lies before the place only fills the replay buffer, what lies behind it
    counts as it did the first time.

    Args:
        config: of the run.
        replay: the replay buffer.
        limiter: counts steps and tells how long actors should pause.
        journal: of the run.
        episodes: of the run.
        evaluators: hosts whose evaluators count besides those of `learner.evaluators`: those that the learner starts.
    """

    def __init__(
        self,
        config: RunConfig,
        replay: ReplayBuffer,
        limiter: RateLimiter,
        journal: Journal,
        episodes: EpisodeLog,
        evaluators: Sequence[str] = (),
    ) -> None:
        self.replay = replay
        self.limiter = limiter
        self.episodes = episodes
        self.means = Means()
        self.steps_rate = RateMeter()
        self.actors = ActorRecords()
        self.version = 0
        """Newest published policy version."""
        self.episode_count = 0
        self.duplicates = 0
        """Deliveries that came again since this process started."""
        self.poisoned = 0
        """Deliveries of the journal that would not be taken today, and were set aside."""
        self.quarantine = Quarantine(replay)
        self.evaluated_at = float("-inf")
        """Monotonic seconds of the newest report of an evaluator."""
        self._keep_replay = config.checkpoints.replay
        self._journal = journal
        certified = certified_hosts(config.bus)
        self.host_of: Callable[[str], str] = partial(host_of, certified=certified)
        """Tells the host of an actor."""
        self._rounds = EvaluationRounds(
            config.maps.validation_count, Evaluators.of(config, certified, evaluators), lambda: self.version
        )
        self._finished_rounds: SimpleQueue[Round] = SimpleQueue()
        self._seen = SeenSet(self.host_of)
        self._admission = Admission(config, self.quarantine, self._seen)
        # Last arrival number of the replay buffer that each journal segment holds.
        self._segment_ends: dict[int, int] = {}
        self._lock = threading.Lock()
        self._arrival = threading.Condition()

    def store(self, delivery: Delivery, payload: bytes | None = None) -> float:
        """Take one valid delivery; return the seconds that its actor should pause.

        A delivery that was stored before changes nothing: this is where at-least-once delivery becomes exactly-once.

        Args:
            delivery: what came.
            payload: the bytes that it came as; encoded here when not given.

        Raises:
            StorageError: when the journal cannot be written; nothing is stored then.
            RefusedError: nothing of this actor is taken any more.
        """
        with self._lock:
            if (delivery.actor, delivery.incarnation, delivery.sequence) in self._seen:
                self.duplicates += 1
            else:
                self._admission.check(delivery)
                segment = self._journal.segment
                self._journal.append(RecordKind.DELIVERY, encode(delivery) if payload is None else payload)
                self._take(delivery, segment)
                self._note_arrival(delivery)
        with self._arrival:
            self._arrival.notify_all()
        return self.limiter.hold()

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
    def stored(self) -> dict[tuple[str, int], list[tuple[int, int]]]:
        """Ranges [first, end) of the sequence numbers that are stored, by (actor, incarnation), of those that speak."""
        with self._lock:
            return self._seen.streams()

    # --- checkpoints -------------------------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Note a place in the journal and all counts at that place, ready for JSON.

        Raises:
            StorageError: when the disk does not take what belongs before that place.
        """
        with self._lock:
            self.episodes.flush()
            self._seen.tidy()
            return {
                "segment": self._journal.rotate(),
                "steps": self.limiter.steps,
                "episodes": self.episode_count,
                "episodes_length": self.episodes.length,
                "version": self.version,
                "seen": self._seen.state(),
                "rounds": self._rounds.state(),
                "quarantine": self.quarantine.state(),
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
        self.limiter.restore(int(snapshot["steps"]), updates)
        self.episode_count = int(snapshot["episodes"])
        self.version = int(snapshot["version"])
        self._seen.restore(snapshot["seen"])
        self._rounds.restore(snapshot["rounds"])
        if "quarantine" in snapshot:  # checkpoints of earlier releases have none
            self.quarantine.restore(snapshot["quarantine"])
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
                logger.error("%s; the replay buffer continues without the rest of it", error)
        if self._journal.losses and (missing := missing_deliveries(self._seen)):
            logger.error("deliveries that the damage has cost: %s", missing)
        if self.poisoned:
            logger.error("%d messages of the journal are not what is taken today, and were set aside", self.poisoned)
        fresh_from = 0 if self._keep_replay and len(self.replay) else int(snapshot["steps"])
        self.limiter.restore(self.limiter.steps, updates, len(self.replay), fresh_from)
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
            delivery = self._read_delivery(record.payload, segment)
            if delivery is None:
                continue
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

    def _read_delivery(self, payload: bytes, segment: int) -> Delivery | None:
        """Return a delivery of the journal, None when it is not what may be stored today."""
        try:
            return decode(payload, Delivery)
        except MessageError as error:
            if error.field == "delivery.v":
                raise CheckpointError(
                    f"journal segment {segment} holds a delivery that this software cannot read ({error}): "
                    "resume the run with the release that wrote it"
                ) from error
            self.poisoned += 1
            if self.poisoned <= _MAX_NAMED:
                logger.error("journal segment %d: set aside %s: %s", segment, describe_delivery(payload), error)
            return None

    # --- parts of storing --------------------------------------------------------------------------------------

    def _take(self, delivery: Delivery, segment: int) -> None:
        """Count a new delivery and keep what it holds."""
        steps = self._fill(delivery, segment)
        self.limiter.note_steps(steps, len(self.replay))
        if isinstance(delivery.body, EpisodeReport):
            self._note_episode(delivery, delivery.body)
        self._seen.add(delivery.actor, delivery.incarnation, delivery.sequence)

    def _fill(self, delivery: Delivery, segment: int) -> int:
        body = delivery.body
        if isinstance(body, Chunk) and (delivery.actor, delivery.incarnation, delivery.sequence) in self.quarantine:
            return body.steps
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
            collected=self.limiter.steps,
            updates=self.limiter.updates,
        )
        if group_of(report) == "evaluate":
            self.evaluated_at = time.monotonic()
            done = self._rounds.add(delivery.actor, delivery.incarnation, report)
            if done is not None:
                self._finished_rounds.put(done)

    def _note_arrival(self, delivery: Delivery) -> None:
        self.actors.note(delivery)
        body = delivery.body
        if isinstance(body, Chunk):
            self.steps_rate.add(body.steps)
            self.means.add({"policy/lag_versions": float(self.version - body.versions.mean())})
