"""The network of the policy and of the critics."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from common.config.section import Section

ImageScale = Literal["range", "spacing"]
"""By what the images of an observation are measured: ranges of the sensor, or lattice steps."""


class NetworkConfig(Section):
    """Encoder, beacon decoder and waypoint decoder (paper, section IV), or the network of a learned baseline."""

    variant: Literal["vanilla", "hierarchical", "hdplanner", "ariadne", "ca", "cnn"] = "hdplanner"
    """`vanilla`: waypoint decoder only. `hierarchical`: beacon, then waypoint. `hdplanner`: hierarchical, with the
    contrastive loss. The paper's learned baselines, complete only with the features and the reward of the preset of
    the same name: `ariadne` and `ca`, pointer over the waypoints; `cnn`, convolutions over images of the map."""
    width: Annotated[int, Field(ge=8, le=1024)] = 128
    """d, the size of a node feature; in `cnn` the channels of the second and third convolution."""
    heads: Annotated[int, Field(ge=1, le=64)] = 8
    """Attention heads; must divide the width. `cnn` has none."""
    layers: Annotated[int, Field(ge=1, le=24)] = 6
    """Encoder layers; `cnn` always has three convolutions."""
    feedforward: Annotated[int, Field(ge=1, le=8)] = 4
    """Hidden size of a feed-forward block, as a multiple of the width."""
    features: Literal["paper", "extended", "guided", "ariadne", "ca"] = "extended"
    """Node features. `paper`: position, utility, visited, beacon, target. `extended`: also graph distance from the
    robot, degree, distance to the nearest useful viewpoint, and whether the node is on a shortest path to a beacon, all
    from the belief. `guided`: also where a classical planner would go (`tour` in exploration, D* Lite in navigation),
    the range of the sensor, and frontiers by length instead of cells. `ariadne`: position, utility, visited. `ca`: also
    direction and distance to the target. `cnn` reads positions alone."""
    graph: Literal["full", "reduced", "tokens"] = "full"
    """Nodes that the network reads. `full`: all reachable nodes. `reduced`: those near the robot, useful ones, beacons
    and the shortest paths to them, about half as many on public maps. `tokens`: as `reduced` up to 128 nodes, beyond
    that only useful nodes and the paths near the robot; needs the features `guided`."""
    toward: bool = False
    """Bias the waypoint decoder's logits by which waypoints lie on a shortest path to which beacon."""

    belief_map: bool = False
    """Read the belief around the robot as a map: a small U-Net over free, occupied and unknown space, one cell to a
    lattice step near the robot and one to four farther away (up to 46 steps); its value at each viewpoint is added to
    the viewpoint's embedding. Observations then have images."""
    beacon_attention: Annotated[int, Field(ge=0, le=8)] = 0
    """Layers of full self-attention among the robot, all beacons and the target, biased by the lengths of the shortest
    paths between them; what they learn is added to their nodes. 2 is a good number; 0 leaves them out."""
    detours: bool = False
    """Bias the waypoint decoder's logits by how each waypoint lies to each beacon: the detour through it, and whether
    it is on a shortest path."""

    @model_validator(mode="after")
    def _maps_are_drawn(self) -> NetworkConfig:
        if self.belief_map and (self.baseline or self.features not in ("extended", "guided")):
            raise ValueError(
                "belief_map draws what the features 'extended' tell: set network.features to 'extended' or 'guided', "
                "and network.variant to 'hdplanner', 'hierarchical' or 'vanilla'"
            )
        return self

    @model_validator(mode="after")
    def _beacons_are_chosen(self) -> NetworkConfig:
        if self.reads_overview and not self.hierarchical:
            name = "beacon_attention" if self.beacon_attention else "detours"
            raise ValueError(
                f"{name} is about beacons, and variant {self.variant!r} chooses none: unset it, or set network.variant "
                "to 'hdplanner'"
            )
        return self

    @model_validator(mode="after")
    def _tokens_are_guided(self) -> NetworkConfig:
        if self.graph == "tokens" and self.features != "guided":
            raise ValueError("graph 'tokens' needs the features 'guided': set network.features to 'guided'")
        return self

    @model_validator(mode="after")
    def _baselines_are_bare(self) -> NetworkConfig:
        if self.baseline and self.toward:
            raise ValueError(
                f"toward biases pairs of beacon and waypoint, and variant {self.variant!r} has none: unset it"
            )
        if self.variant == "cnn" and self.features == "guided":
            raise ValueError(f"variant {self.variant!r} reads no route: set network.features to 'paper'")
        return self

    @model_validator(mode="after")
    def _heads_divide_width(self) -> NetworkConfig:
        if self.width % self.heads:
            raise ValueError(f"heads ({self.heads}) must divide width ({self.width}): choose for example 4 or 8 heads")
        return self

    @property
    def hierarchical(self) -> bool:
        """Whether a beacon is chosen before the waypoint; otherwise each observation has one dummy beacon."""
        return self.variant in ("hierarchical", "hdplanner")

    @property
    def baseline(self) -> bool:
        """Whether it is the network of another publication, without beacons."""
        return self.variant in ("ariadne", "ca", "cnn")

    @property
    def reads_overview(self) -> bool:
        """Whether it reads lengths of paths between robot, beacons and target."""
        return self.beacon_attention > 0 or self.detours

    @property
    def reads_image(self) -> bool:
        """Whether observations must have an image of the map."""
        return self.image_scale is not None

    @property
    def image_scale(self) -> ImageScale | None:
        """By what images of the map are measured; None where they are not read."""
        if self.variant == "cnn":
            return "range"
        return "spacing" if self.belief_map else None

    @property
    def sees_target(self) -> bool:
        """Whether any input tells where a target is."""
        return self.features != "ariadne" and self.variant != "cnn"
