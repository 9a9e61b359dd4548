"""The bus, and what actors send over it."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from common.config.endpoint import BusEndpoint
from common.config.section import Seconds, Section
from common.system.steady_time import LONGEST_WAIT


class ActorConfig(Section):
    """Actors."""

    chunk_steps: Annotated[int, Field(ge=1, le=256)] = 16
    """Steps per message."""
    window: Annotated[int, Field(ge=1, le=32)] = 16
    """Maximum number of unacknowledged messages in flight."""
    buffer_chunks: Annotated[int, Field(ge=1)] = 512
    """Messages buffered while the learner is away; when the buffer is full, the actor pauses and logs it."""
    weights_timeout: Seconds = 10.0
    """Interval at which an actor asks for new weights if no announcement arrives, seconds."""


class BusConfig(Section):
    """The Zenoh bus."""

    listen: BusEndpoint = "tcp/127.0.0.1:7447"
    """Endpoint on which the learner listens; loopback only by default."""
    connect: tuple[BusEndpoint, ...] = ()
    """Existing Zenoh routers that the learner also joins."""
    lease: Annotated[float, Field(ge=0.1, le=LONGEST_WAIT)] = 2.0
    """Silence after which a process counts as gone, seconds."""
    ack_timeout: Seconds = 3.0
    """Time after which an unacknowledged message is resent, seconds."""
    shared_memory: bool = False
    """Use Zenoh's shared-memory transport between processes on one machine: faster, but needs more memory."""
    compression: bool = False
    """Compress what crosses a link when both of its ends have this on: for narrow lines between sites."""
    tls_ca: str | None = None
    """Root certificate (PEM). Setting it makes all links use mutual TLS; `hd-learner certificates` creates the
    files."""
    tls_certificate: str | None = None
    """This process's certificate (PEM)."""
    tls_key: str | None = None
    """This process's private key (PEM)."""
    tls_access: str | None = None
    """The learner's access rules (JSON): which certificate may read and write which keys. `hd-learner certificates`
    writes them; without them, every certificate of the authority may do everything."""

    @field_validator("listen")
    @classmethod
    def _others_can_be_told(cls, value: str) -> str:
        if re.search(r":0+(?=[?#]|$)", value):
            raise ValueError("port 0 is any that is free, and no actor could be told which: name one, such as 7447")
        return value

    @model_validator(mode="after")
    def _tls_is_complete(self) -> BusConfig:
        given = [self.tls_ca, self.tls_certificate, self.tls_key]
        if any(given) and not all(given):
            raise ValueError("tls_ca, tls_certificate and tls_key go together: give all three or none")
        return self
