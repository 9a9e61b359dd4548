"""What the command lines of the actors' side share."""

from __future__ import annotations

from enum import StrEnum

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"


class Fidelity(StrEnum):
    """Fidelities of PyBullet to choose from."""

    KINEMATIC = "kinematic"
    DYNAMIC = "dynamic"
