"""Names and shapes of a policy's weights as they are stored and sent, independent of torch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.errors import WeightsError
from common.observations.features import feature_count

Shapes = dict[str, tuple[int, ...]]
Arrays = Mapping[str, NDArray[np.float32]]


def parameter_shapes(config: NetworkConfig) -> Shapes:
    """Return the name and shape of every weight of `PolicyNetwork(config)`, in the order of its state."""
    width, hidden = config.width, config.feedforward * config.width
    shapes: Shapes = {}

    def linear(name: str, inputs: int, outputs: int, bias: bool = True) -> None:
        shapes[f"{name}.weight"] = (outputs, inputs)
        if bias:
            shapes[f"{name}.bias"] = (outputs,)

    def norm(name: str) -> None:
        shapes[f"{name}.weight"] = (width,)
        shapes[f"{name}.bias"] = (width,)

    def feedforward(name: str) -> None:
        linear(f"{name}.rise", width, hidden)
        linear(f"{name}.fall", hidden, width)

    def decoder(name: str) -> None:
        norm(f"{name}.decoder.attention_norm")
        linear(f"{name}.decoder.attention.query", width, width, bias=False)
        linear(f"{name}.decoder.attention.kv", width, 2 * width, bias=False)
        linear(f"{name}.decoder.attention.out", width, width)
        norm(f"{name}.decoder.feedforward_norm")
        feedforward(f"{name}.decoder.feedforward")
        norm(f"{name}.decoder.norm")
        linear(f"{name}.pointer.query", width, width, bias=False)
        linear(f"{name}.pointer.key", width, width, bias=False)

    linear("encoder.embedding", feature_count(config.features), width)
    for layer in range(config.layers):
        name = f"encoder.layers.{layer}"
        norm(f"{name}.attention_norm")
        linear(f"{name}.attention.qkv", width, 3 * width, bias=False)
        linear(f"{name}.attention.out", width, width)
        norm(f"{name}.feedforward_norm")
        feedforward(f"{name}.feedforward")
    norm("encoder.norm")
    if config.variant != "vanilla":
        decoder("beacon_decoder")
    linear("waypoint_decoder.join", (1 if config.variant == "vanilla" else 2) * width, width)
    if config.toward:
        shapes["waypoint_decoder.toward"] = (1,)
    decoder("waypoint_decoder")
    return shapes


def initial_parameters(config: NetworkConfig, seed: int) -> dict[str, NDArray[np.float32]]:
    """Draw random weights: uniform in ±1/sqrt(inputs) for linear maps, ones and zeros for norms."""
    rng = np.random.default_rng(seed)
    arrays: dict[str, NDArray[np.float32]] = {}
    bound = 1.0
    for name, shape in parameter_shapes(config).items():
        kind = name.split(".")[-2]
        if name.endswith(".toward"):
            arrays[name] = np.zeros(shape, dtype=np.float32)
            continue
        if "norm" in kind:
            arrays[name] = np.full(shape, float(name.endswith("weight")), dtype=np.float32)
            continue
        if len(shape) == 2:
            bound = shape[1] ** -0.5
        arrays[name] = rng.uniform(-bound, bound, shape).astype(np.float32)
    return arrays


def with_features(arrays: Arrays, trained: NetworkConfig, wanted: NetworkConfig) -> dict[str, NDArray[np.float32]]:
    """Return weights for a network that reads more, which changes nothing at first: the new weights are 0.

    Args:
        arrays: weights of a network of ``trained``.
        trained: its configuration; its features are the first ones of those wanted, or the same.
        wanted: configuration of the network that begins with these weights.
    """
    name = "encoder.embedding.weight"
    missing = feature_count(wanted.features) - feature_count(trained.features)
    grown = dict(arrays)
    if missing > 0 and name in grown:
        grown[name] = np.pad(grown[name], ((0, 0), (0, missing)))
    if wanted.toward:
        grown.setdefault("waypoint_decoder.toward", np.zeros(1, dtype=np.float32))
    return grown


def check_parameters(arrays: Arrays, shapes: Shapes) -> None:
    """Refuse weights that do not fit.

    Raises:
        WeightsError: a weight is missing, unknown, of another shape or type, or not finite; the error names it.
    """
    for name, shape in shapes.items():
        if name not in arrays:
            raise WeightsError(f"weight {name} of shape {shape} is missing: were these made for a different network?")
        came = arrays[name]
        if came.shape != shape:
            raise WeightsError(
                f"weight {name}: expected shape {shape}, got {came.shape}: load it with the network "
                "configuration that it was trained with"
            )
        if came.dtype != np.float32:
            raise WeightsError(f"weight {name}: expected float32, got {came.dtype}: convert it before loading")
        if not np.isfinite(came).all():
            raise WeightsError(f"weight {name} holds values that are not finite: training has diverged")
    unknown = sorted(set(arrays) - set(shapes))
    if unknown:
        raise WeightsError(f"weight {unknown[0]} is unknown to this network: was it made for another variant?")
