"""The bus, and what actors send over it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from common.config.section import Positive, Section


class ActorConfig(Section):
    """Actors."""

    chunk_steps: Annotated[int, Field(ge=1, le=256)] = 16
    """Steps per message."""
    window: Annotated[int, Field(ge=1, le=32)] = 16
    """Unacknowledged messages in flight at most."""
    buffer_chunks: Annotated[int, Field(ge=1)] = 512
    """Messages kept while the learner is away; then the actor pauses, and says so."""
    weights_timeout: Positive = 10.0
    """Seconds between two pulls of the weights when no notice comes."""


class BusConfig(Section):
    """The Zenoh bus."""

    listen: str = "tcp/127.0.0.1:7447"
    """Endpoint on which the learner listens; loopback only by default."""
    connect: tuple[str, ...] = ()
    """Existing Zenoh routers that the learner joins as well."""
    lease: Positive = 2.0
    """Seconds of silence after which a process counts as gone."""
    ack_timeout: Positive = 3.0
    """Seconds to wait for an acknowledgement before a message is sent again."""
    shared_memory: bool = False
    """Zenoh's shared-memory transport between processes of one machine: faster, more memory."""
    tls_ca: str | None = None
    """Root certificate (PEM). With it, links use mutual TLS; make the files with `hd-learner certificates`."""
    tls_certificate: str | None = None
    """This process's certificate (PEM)."""
    tls_key: str | None = None
    """This process's private key (PEM)."""
    tls_access: str | None = None
    """The learner's access rules (JSON): who may read and write which key, by certificate. The command
    `hd-learner certificates` writes them; without them every certificate of the authority may do everything."""

    @model_validator(mode="after")
    def _tls_is_complete(self) -> BusConfig:
        given = [self.tls_ca, self.tls_certificate, self.tls_key]
        if any(given) and not all(given):
            raise ValueError("tls_ca, tls_certificate and tls_key go together: give all three or none")
        return self
