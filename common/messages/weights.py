"""Policy weights on the bus: the announcement, the tensors, and the digest that ties both together."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError
from common.messages.codec import pack_array

FLOATS = ("float16", "float32", "float64")
MAX_WEIGHT = 65504.0
"""Largest magnitude of a weight, that of float16: far beyond what training reaches."""
MAX_WEIGHTS = 1 << 28
"""Bytes that the weights of a policy may have."""


@dataclass(frozen=True, slots=True)
class WeightsNotice:
    """The announcement of a policy version: so small that a frozen actor delays nobody.

    Attributes:
        learner: incarnation of the learner.
        version: policy version, rising within an incarnation.
        updates: gradient updates behind this version.
        averaged: True for the moving average of the weights that evaluation uses.
        bytes: size of the tensors.
        digest: SHA-256 of the tensors, hexadecimal; see `digest_of`.
    """

    learner: int
    version: int
    updates: int
    averaged: bool
    bytes: int
    digest: str


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """One policy version.

    Attributes:
        learner: incarnation of the learner.
        version: policy version, rising within an incarnation.
        updates: gradient updates behind this version.
        averaged: True for the moving average of the weights that evaluation uses.
        tensors: name to array of floats.
        digest: SHA-256 of the tensors, hexadecimal; see `digest_of`.
    """

    learner: int
    version: int
    updates: int
    averaged: bool
    tensors: Mapping[str, NDArray[Any]]
    digest: str

    @classmethod
    def of(
        cls,
        tensors: Mapping[str, NDArray[Any]],
        *,
        learner: int,
        version: int,
        updates: int,
        averaged: bool = False,
    ) -> Weights:
        """Make a version from named arrays of floats; raise TypeError for any other dtype."""
        for name, tensor in tensors.items():
            if tensor.dtype.name not in FLOATS:
                raise TypeError(f"weights must be {', '.join(FLOATS)}, got {tensor.dtype.name} in {name!r}")
        return cls(learner, version, updates, averaged, dict(tensors), digest_of(tensors))

    def notice(self) -> WeightsNotice:
        """Return the announcement of this version."""
        size = sum(tensor.nbytes for tensor in self.tensors.values())
        return WeightsNotice(self.learner, self.version, self.updates, self.averaged, size, self.digest)

    def check(self, path: str) -> None:
        """Raise MessageError when a number is not finite or too large, or the digest is not that of the tensors."""
        for name, tensor in self.tensors.items():
            # Written so that NaN fails.
            if not (np.abs(tensor) <= MAX_WEIGHT).all():
                raise MessageError(f"{path}.tensors.{name}", f"must be finite, and at most {MAX_WEIGHT:g} in magnitude")
        digest = digest_of(self.tensors)
        if digest != self.digest:
            raise MessageError(f"{path}.digest", f"must be that of the tensors, {digest}, got {self.digest}")


def digest_of(tensors: Mapping[str, NDArray[Any]]) -> str:
    """Return the SHA-256 of named arrays as 64 hexadecimal digits.

    Hashed are, in the order of the names' UTF-8 bytes: the name, one zero byte, the array's extension payload.
    """
    digest = hashlib.sha256()
    for name in sorted(tensors, key=lambda name: name.encode("utf-8")):
        digest.update(name.encode("utf-8") + b"\0")
        digest.update(pack_array(tensors[name]))
    return digest.hexdigest()
