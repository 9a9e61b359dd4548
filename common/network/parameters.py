"""Names and shapes of a policy's weights as they are stored and sent, independent of torch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.errors import WeightsError
from common.network.belief_layers import belief_layers
from common.network.image_layers import TABLE_SIDE, ImageLayer, image_layers
from common.observations.feature_sets import FEATURE_NAMES, feature_count
from common.observations.observation import IMAGES
from common.observations.overview import CLOSENESS, PAIR_FEATURES

_OPTIONS = ("encoder.belief_map.", "encoder.beacon_attention.", "waypoint_decoder.detours.", "waypoint_decoder.toward")
# The last maps of options: while they are zero, a network decides as without the option.
_SILENT = (
    "encoder.belief_map.out.",
    "encoder.beacon_attention.out.",
    "waypoint_decoder.detours.fall.",
    "waypoint_decoder.toward",
)

Shapes = dict[str, tuple[int, ...]]
Arrays = Mapping[str, NDArray[np.float32]]


def parameter_shapes(config: NetworkConfig) -> Shapes:
    """Return the name and shape of every weight of the network of ``config``, in the order of its state."""
    shapes = _Shapes(config)
    if config.variant == "cnn":
        shapes.image()
    else:
        shapes.graph()
    return shapes.found


class _Shapes:
    """Collects names and shapes; each method adds those of one module."""

    def __init__(self, config: NetworkConfig) -> None:
        self.found: Shapes = {}
        self._config = config

    def graph(self) -> None:
        """Add a network over viewpoints: of the paper's variants, or a pointer alone."""
        config, width = self._config, self._config.width
        self.linear("encoder.embedding", feature_count(config.features), width)
        if config.belief_map:
            layers = belief_layers(config)
            for convolution in layers:
                self.convolution(f"encoder.belief_map.{convolution.name}", convolution)
            self.linear("encoder.belief_map.out", layers.up_0.outputs, width, bias=False)
        for layer in range(config.layers):
            name = f"encoder.layers.{layer}"
            self.norm(f"{name}.attention_norm")
            self.linear(f"{name}.attention.qkv", width, 3 * width, bias=False)
            self.linear(f"{name}.attention.out", width, width)
            self.norm(f"{name}.feedforward_norm")
            self.feedforward(f"{name}.feedforward")
        self.norm("encoder.norm")
        if config.beacon_attention:
            self.beacon_attention("encoder.beacon_attention")
        if config.hierarchical:
            self.decoder("beacon_decoder")
        self.linear("waypoint_decoder.join", (1 if config.variant == "vanilla" else 2) * width, width)
        if config.toward:
            self.found["waypoint_decoder.toward"] = (1,)
        self.decoder("waypoint_decoder")
        if config.detours:
            self.linear("waypoint_decoder.detours.rise", PAIR_FEATURES, width)
            self.linear("waypoint_decoder.detours.fall", width, 1)

    def image(self) -> None:
        """Add a network over images."""
        for name in IMAGES:
            for layer in image_layers(self._config):
                self.convolution(f"encoder.{name}.{layer.name}", layer)
        hidden = self._config.feedforward * self._config.width
        self.linear("table.join", len(IMAGES) * image_layers(self._config)[-1].values, hidden)
        self.linear("table.values", hidden, TABLE_SIDE**2)

    def convolution(self, name: str, layer: ImageLayer) -> None:
        """Add a convolution, whose weights are a matrix."""
        self.linear(name, layer.inputs * layer.side**2, layer.outputs)

    def linear(self, name: str, inputs: int, outputs: int, bias: bool = True) -> None:
        """Add a linear map."""
        self.found[f"{name}.weight"] = (outputs, inputs)
        if bias:
            self.found[f"{name}.bias"] = (outputs,)

    def norm(self, name: str) -> None:
        """Add a layer norm."""
        self.found[f"{name}.weight"] = (self._config.width,)
        self.found[f"{name}.bias"] = (self._config.width,)

    def feedforward(self, name: str) -> None:
        """Add a feed-forward block."""
        width, hidden = self._config.width, self._config.feedforward * self._config.width
        self.linear(f"{name}.rise", width, hidden)
        self.linear(f"{name}.fall", hidden, width)

    def beacon_attention(self, name: str) -> None:
        """Add layers of attention among robot, beacons and target."""
        width = self._config.width
        for number in range(self._config.beacon_attention):
            layer = f"{name}.layers.{number}"
            self.norm(f"{layer}.attention_norm")
            self.linear(f"{layer}.qkv", width, 3 * width, bias=False)
            self.linear(f"{layer}.bias", CLOSENESS, self._config.heads, bias=False)
            self.linear(f"{layer}.out", width, width)
            self.norm(f"{layer}.feedforward_norm")
            self.feedforward(f"{layer}.feedforward")
        self.norm(f"{name}.norm")
        self.linear(f"{name}.out", width, width)

    def decoder(self, name: str) -> None:
        """Add a decoder layer and its pointer."""
        width = self._config.width
        self.norm(f"{name}.decoder.attention_norm")
        self.linear(f"{name}.decoder.attention.query", width, width, bias=False)
        self.linear(f"{name}.decoder.attention.kv", width, 2 * width, bias=False)
        self.linear(f"{name}.decoder.attention.out", width, width)
        self.norm(f"{name}.decoder.feedforward_norm")
        self.feedforward(f"{name}.decoder.feedforward")
        self.norm(f"{name}.decoder.norm")
        self.linear(f"{name}.pointer.query", width, width, bias=False)
        self.linear(f"{name}.pointer.key", width, width, bias=False)


def initial_parameters(config: NetworkConfig, seed: int) -> dict[str, NDArray[np.float32]]:
    """Draw random weights: uniform in ±1/sqrt(inputs) for linear maps, ones and zeros for norms.

    Options begin silent: their last map is zero.
    """
    rng = np.random.default_rng(seed)
    arrays: dict[str, NDArray[np.float32]] = {}
    bound = 1.0
    for name, shape in parameter_shapes(config).items():
        kind = name.split(".")[-2]
        if name.startswith(_SILENT):
            arrays[name] = np.zeros(shape, dtype=np.float32)
            continue
        if "norm" in kind:
            arrays[name] = np.full(shape, float(name.endswith("weight")), dtype=np.float32)
            continue
        if len(shape) == 2:
            bound = shape[1] ** -0.5
        arrays[name] = rng.uniform(-bound, bound, shape).astype(np.float32)
    return arrays


def with_options(
    arrays: Arrays, trained: NetworkConfig, wanted: NetworkConfig, seed: int = 0
) -> dict[str, NDArray[np.float32]]:
    """Return weights for a network that reads more, which changes nothing at first.

    Weights of new features are 0, and so are the last maps of new options; what lies before these is drawn.

    Args:
        arrays: weights of a network of ``trained``.
        trained: its configuration; its features are the first ones of those wanted, or the same.
        wanted: configuration of the network that begins with these weights.
        seed: of what is drawn.

    Raises:
        WeightsError: its features do not begin with those that the weights were trained with, it has more layers of
            attention among beacons than these, or another number of heads.
    """
    before, after = FEATURE_NAMES[trained.features], FEATURE_NAMES[wanted.features]
    if after[: len(before)] != before:
        raise WeightsError(
            f"weights of a network with the features {trained.features!r} cannot go on with {wanted.features!r}: set "
            f"network.features={trained.features}"
        )
    if trained.beacon_attention not in (0, wanted.beacon_attention):
        raise WeightsError(
            f"weights of a network with {trained.beacon_attention} layers of attention among beacons cannot go on with "
            f"{wanted.beacon_attention}: set network.beacon_attention={trained.beacon_attention}"
        )
    _check_heads(trained, wanted)
    name = "encoder.embedding.weight"
    missing = len(after) - len(before)
    grown = dict(arrays)
    if missing > 0 and name in grown:
        grown[name] = np.pad(grown[name], ((0, 0), (0, missing)))
    for option, values in initial_parameters(wanted, seed).items():
        if option.startswith(_OPTIONS):
            grown.setdefault(option, values)
    return grown


def check_successor(trained: NetworkConfig, wanted: NetworkConfig) -> None:
    """Refuse a network that cannot go on with all weights of another one as they are.

    Raises:
        WeightsError: it reads other features, has other weights, or reads them in other heads.
    """
    if trained.features != wanted.features:
        raise WeightsError(f"it reads network.features={trained.features}, not {wanted.features}")
    _check_heads(trained, wanted)
    before, after = parameter_shapes(trained), parameter_shapes(wanted)
    for name in sorted(before.keys() | after.keys(), key=list({**before, **after}).index):
        if before.get(name) != after.get(name):
            raise WeightsError(
                f"weight {name} would have the shape {after.get(name, 'none')} instead of {before.get(name, 'none')}"
            )


def _check_heads(trained: NetworkConfig, wanted: NetworkConfig) -> None:
    """Refuse another number of heads, which the shapes of the weights do not show."""
    if trained.heads != wanted.heads and wanted.variant != "cnn":
        raise WeightsError(
            f"weights that were trained with {trained.heads} heads of attention mean something else with "
            f"{wanted.heads}: set network.heads={trained.heads}"
        )


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
