"""What the implementations of the policy network (torch, numpy, ONNX) share about its logits."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

LOGIT_LIMIT: Final = 10.0
"""Logits are squashed to this range, which bounds how sure a decision can be."""


def log_softmax(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """Normalise logits, shape (queries, choices), to log-probabilities of each row."""
    shifted = logits - logits.max(axis=1, keepdims=True)
    normalised: NDArray[np.float32] = shifted - np.log(np.exp(shifted).sum(axis=1, keepdims=True))
    return normalised
