"""Services of a node: requests are Zenoh queries, their answers replies, both with the attachments of rmw_zenoh."""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from common.bus.query import QueryServer, ask_until_answered
from common.errors import HDError
from common.system.closing import Closing
from deploy.ros2.errors import RosError
from deploy.ros2.keys import Attachment
from deploy.ros2.messages import Message, deserialize, serialize

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ServiceEndpoint:
    """What a service is declared or called with.

    Attributes:
        name: absolute name.
        kind: service type, such as `lifecycle_msgs/srv/GetState`.
        distro: distribution of the type.
        key: Zenoh key of the requests.
        token: liveliness token of the server.
        gid: identity in attachments, or None.
    """

    name: str
    kind: str
    distro: str
    key: str
    token: str
    gid: bytes | None


class Service(Closing):
    """Answers requests in a thread of its own; an HDError goes to the asker, any other is logged and unanswered.

    Attributes:
        name: absolute name.
        kind: service type.
    """

    def __init__(
        self,
        session: zenoh.Session,
        endpoint: ServiceEndpoint,
        handle: Callable[[Message], Message],
        threads: int = 1,
    ) -> None:
        """Offer the service.

        Args:
            session: of the node.
            endpoint: name and type.
            handle: makes the response to a request.
            threads: that answer, where a response may take its time.
        """
        self.name = endpoint.name
        self.kind = endpoint.kind
        self._endpoint = endpoint
        self._handle = handle
        self._server = QueryServer(session, endpoint.key, self._answer, threads=threads)
        self._token = session.liveliness().declare_token(endpoint.token)
        self._closed = False

    def close(self) -> None:
        """Withdraw the service. Safe to call twice."""
        if not self._closed:
            self._closed = True
            self._token.undeclare()
            self._server.close()

    def _answer(self, query: zenoh.Query) -> None:
        payload = b"" if query.payload is None else query.payload.to_bytes()
        try:
            request = deserialize(payload, f"{self.kind}_Request", self._endpoint.distro)
            response = serialize(self._handle(request), f"{self.kind}_Response", self._endpoint.distro)
        except HDError as error:
            query.reply_err(str(error).encode())
            log.warning("service %s: %s", self.name, error)
            return
        note = None if query.attachment is None else Attachment.unpack(query.attachment.to_bytes())
        query.reply(
            query.key_expr,
            response,
            encoding=zenoh.Encoding.APPLICATION_CDR,
            # Its asker knows an answer by the number and the identity that came with the request.
            attachment=None if note is None else Attachment(note.sequence, time.time_ns(), note.gid).pack(),
        )


class Client:
    """Calls a service; safe to use from several threads.

    Attributes:
        name: absolute name.
        kind: service type.
    """

    def __init__(self, session: zenoh.Session, endpoint: ServiceEndpoint) -> None:
        self.name = endpoint.name
        self.kind = endpoint.kind
        self._session = session
        self._endpoint = endpoint
        self._numbers = itertools.count(1)

    def call(self, request: Message, timeout: float = 2.0) -> Message:
        """Return the response to a request.

        Raises:
            RosError: nobody answers in time, or with something else.
        """
        distro = self._endpoint.distro
        payload = self.call_raw(serialize(request, f"{self.kind}_Request", distro), timeout)
        return deserialize(payload, f"{self.kind}_Response", distro)

    def call_raw(self, request: bytes, timeout: float = 2.0) -> bytes:
        """Return the CDR of the response to a request that is CDR already.

        It is sent again until somebody answers, so it must be one that may be repeated.

        Raises:
            RosError: nobody answers in time, or the service cannot read the request.
        """
        gid = self._endpoint.gid
        note = None if gid is None else Attachment(next(self._numbers), time.time_ns(), gid).pack()
        for reply in ask_until_answered(self._session, self._endpoint.key, timeout, request, attachment=note):
            if reply.ok is not None:
                return bytes(reply.ok.payload.to_bytes())
            if reply.err is not None:
                why = reply.err.payload.to_bytes()[:500].decode(errors="replace")
                raise RosError(f"service {self.name} refuses the request: {why}")
        raise RosError(f"service {self.name} did not answer within {timeout:g} s: check that its node is running")
