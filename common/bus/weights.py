"""Policy weights: the learner announces a version, and everybody pulls it when it suits them."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from queue import Empty, SimpleQueue

import zenoh

from common.bus.keys import Keys
from common.bus.query import QueryServer, ask
from common.errors import MessageError
from common.messages.schema import decode, encode
from common.messages.weights import MAX_WEIGHTS, Weights, WeightsNotice
from common.system.closing import Closing
from common.system.threads import Complaints, guarded

log = logging.getLogger(__name__)

# Several, so that a client that stopped reading in the middle of a reply does not delay the others.
_SERVING_THREADS = 4
_RETRY_SECONDS = 0.5
_PULL_TIMEOUT = 10.0


class WeightsPublisher(Closing):
    """The learner's side: keeps the newest version for whoever asks, and announces it.

    Usage::

        with WeightsPublisher(session, "run") as publisher:
            publisher.publish(Weights.of(policy, learner=incarnation, version=1, updates=10))
    """

    def __init__(self, session: zenoh.Session, run: str) -> None:
        self._session = session
        self._keys = Keys(run)
        self._newest: tuple[bytes, WeightsNotice] | None = None
        self._averaged: tuple[bytes, WeightsNotice] | None = None
        self._server = QueryServer(session, self._keys.weights, self._answer, threads=_SERVING_THREADS)

    def publish(self, weights: Weights, averaged: Weights | None = None) -> WeightsNotice:
        """Make a version the newest one and announce it; its arrays may change afterwards.

        Args:
            weights: what actors use.
            averaged: the moving average of the same version, for those who ask for it; they get ``weights``
                when there is none.
        """
        notice = weights.notice()
        newest = encode(weights), notice
        average = newest if averaged is None else (encode(averaged), averaged.notice())
        self._newest, self._averaged = newest, average
        self._session.put(self._keys.weights_notice, encode(notice), congestion_control=zenoh.CongestionControl.DROP)
        return notice

    def _answer(self, query: zenoh.Query) -> None:
        entry = self._averaged if query.parameters.get("averaged") == "1" else self._newest
        if entry is None:
            return
        data, notice = entry
        up_to_date = query.parameters.get("have") == _version_id(notice)
        query.reply(query.key_expr, encode(notice) if up_to_date else data)

    def close(self) -> None:
        """Stop serving. Safe to call twice."""
        self._server.close()


class WeightsPuller(Closing):
    """Everybody else's side: holds the newest version, pulled at the start, on notice, on a timer, and when a
    learner appears.

    A version is used only when its digest fits, its numbers are finite and its shapes are the expected ones;
    otherwise the one before stays and the log says why. The newest version of a learner wins; a restarted learner's
    version wins over everything that its predecessor published.

    Usage::

        with WeightsPuller(session, "run") as puller:
            weights = puller.wait(timeout=10.0)

    Args:
        session: an open session.
        run: name of the run.
        timer: seconds between two pulls when no notice comes.
        averaged: pull the moving average that evaluation uses; `Weights.averaged` tells whether the learner has one.
        shapes: expected shape of every tensor by name; anything else is refused. Not checked when not given.
    """

    def __init__(
        self,
        session: zenoh.Session,
        run: str,
        *,
        timer: float = 10.0,
        averaged: bool = False,
        shapes: Mapping[str, tuple[int, ...]] | None = None,
    ) -> None:
        self._session = session
        self._keys = Keys(run)
        self._timer = timer
        self._averaged = averaged
        self._shapes = None if shapes is None else {name: tuple(shape) for name, shape in shapes.items()}
        self._weights: Weights | None = None
        self._arrived = 0.0
        self._changed = threading.Condition()
        self._closed = False
        self._calls: SimpleQueue[zenoh.Sample | None] = SimpleQueue()
        self.refused = 0
        """Versions that came and could not be used."""
        self._thread = threading.Thread(target=self._work, name=f"weights of {run}", daemon=True)
        self._subscribers = [
            session.declare_subscriber(
                self._keys.weights_notice,
                zenoh.handlers.Callback(guarded("hearing of weights", self._calls.put), indirect=False),
            ),
            session.liveliness().declare_subscriber(
                self._keys.live("learner", "learner"),
                zenoh.handlers.Callback(guarded("watching the learner", self._learner_seen), indirect=False),
            ),
        ]
        self._thread.start()

    def latest(self) -> Weights | None:
        """Return the newest usable version, None before the first."""
        return self._weights

    @property
    def age(self) -> float:
        """Seconds since the newest version arrived; 0 before the first."""
        return time.monotonic() - self._arrived if self._weights is not None else 0.0

    def wait(self, timeout: float | None = None, after: Weights | None = None) -> Weights | None:
        """Wait for a version other than ``after``; return None when the time is up before."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._weights is not after, timeout)
            return self._weights if self._weights is not after else None

    def close(self) -> None:
        """Stop pulling. Safe to call twice."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
            self._changed.notify_all()
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._calls.put(None)

    def _learner_seen(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._calls.put(None)

    def _work(self) -> None:
        # This thread is the only one that ever brings weights: nothing that comes may end it.
        complaints = Complaints("asking for weights", lambda: self._closed or self._session.is_closed())
        while not self._closed:
            with complaints:
                self._pull()
                self._wait_for_call()
                continue
            if self._session.is_closed():
                return
            time.sleep(_RETRY_SECONDS)

    def _wait_for_call(self) -> None:
        """Wait until a pull is due: a learner appeared, a notice of something new came, or the timer ran out."""
        end = time.monotonic() + (_RETRY_SECONDS if self._weights is None else self._timer)
        while not self._closed:
            try:
                sample = self._calls.get(timeout=max(0.0, end - time.monotonic()))
            except Empty:
                return
            if sample is None or self._is_news(sample):
                return

    def _is_news(self, sample: zenoh.Sample) -> bool:
        try:
            notice = decode(sample.payload.to_bytes(), WeightsNotice)
        except MessageError as error:
            log.warning("refused a notice of weights: %s", error)
            return False
        have = self._weights
        return have is None or _is_newer(notice, have)

    def _pull(self) -> None:
        have = self._weights
        parameters = f"averaged={int(self._averaged)}" + ("" if have is None else f";have={_version_id(have)}")
        for reply in ask(self._session, f"{self._keys.weights}?{parameters}", _PULL_TIMEOUT):
            if reply.ok is None:
                continue
            try:
                self._consider(reply.ok.payload)
            except MessageError as error:
                self.refused += 1
                log.warning("refused weights, keeping version %s: %s", have and have.version, error)

    def _consider(self, payload: zenoh.ZBytes) -> None:
        if len(payload) > MAX_WEIGHTS:
            raise MessageError("weights", f"must have at most {MAX_WEIGHTS} bytes, got {len(payload)}")
        weights = decode(payload.to_bytes(), Weights, WeightsNotice)
        if isinstance(weights, WeightsNotice):
            return
        self._check_shapes(weights)
        if self._weights is not None and not _is_newer(weights, self._weights):
            return
        with self._changed:
            self._weights = weights
            self._arrived = time.monotonic()
            self._changed.notify_all()

    def _check_shapes(self, weights: Weights) -> None:
        if self._shapes is None:
            return
        for name, shape in self._shapes.items():
            tensor = weights.tensors.get(name)
            if tensor is None or tensor.shape != shape:
                came = "nothing" if tensor is None else tensor.shape
                raise MessageError(f"weights.tensors.{name}", f"must have the shape {shape}, got {came}")
        for name in weights.tensors:
            if name not in self._shapes:
                raise MessageError(f"weights.tensors.{name}", "is no tensor of this network")


def _version_id(version: Weights | WeightsNotice) -> str:
    return f"{version.learner}:{version.version}"


def _is_newer(new: Weights | WeightsNotice, old: Weights) -> bool:
    return new.learner != old.learner or new.version > old.version
