"""The configuration tree: every setting of a run, typed, bounded and documented in one place.

The text of a field is its documentation: `hd-learner config --describe` and docs/configuration.md are made from it.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from common.ids import ID_PATTERN
from common.tasks import BOTH, EXPLORATION, Task, find_task

MAX_FAMILIES = 64
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Positive = Annotated[float, Field(gt=0.0)]


class Section(BaseModel):
    """Base of all sections: unknown names are errors, values never change after validation."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)


class MapsConfig(Section):
    """Where worlds come from."""

    train: tuple[str, ...] = ("generator:rooms",)
    """Sources of training worlds: folders of maps, map files with a start (`plan.yaml?start=1.5,2`), or
    `generator:NAME[?key=value&...]`; docs/maps.md has them all. Drawn evenly from all."""
    validation: tuple[str, ...] = ("generator:rooms?seed=1000000",)
    """Sources of validation worlds, used by evaluating actors to choose the best checkpoint. Never the bench maps."""
    validation_count: Annotated[int, Field(ge=1, le=10_000)] = 50
    """How many validation worlds one evaluation uses."""
    train_navigation: tuple[str, ...] = ()
    """Sources for the navigation episodes of a run with `both_tasks`, which need targets; `train` when not given."""
    validation_navigation: tuple[str, ...] = ()
    """Likewise for validation; half of `validation_count` comes from either."""
    metres_per_pixel: Positive | None = None
    """Scale of images and of generated worlds; when not given that of their set (`worlds.toml`), else 0.25. ROS maps
    have their own."""


class MappingConfig(Section):
    """Belief, viewpoint graph, utility and beacons: the same in simulation and on the robot."""

    resolution: Positive = 0.25
    """Belief cell, metres."""
    sensor_range: Positive = 20.0
    """Range of the robot's sensor, metres; longer readings count as 'nothing met' at this range."""
    viewpoint_spacing: Positive = 4.0
    """Distance between neighbouring viewpoints of the lattice, metres."""
    robot_radius: Annotated[float, Field(ge=0.0)] = 0.0
    """Radius of the robot, metres: no edge of the viewpoint graph leads through less clearance; 0 for a point."""
    utility_range: Positive | None = None
    """A viewpoint observes frontiers up to this distance, metres; the sensor range when not given."""
    min_utility: Annotated[int, Field(ge=1)] = 2
    """A viewpoint that observes fewer frontiers counts as useless (utility 0), as long as another one is useful."""
    least_utility: Annotated[int, Field(ge=1)] = 2
    """When no viewpoint observes `min_utility` frontiers any more, those that observe so many are useful."""
    beacon_range: Positive = 20.0
    """d_th of Algorithm 1: a beacon covers useful viewpoints up to this distance in line of sight, metres."""

    @property
    def observable_range(self) -> float:
        """Range within which a viewpoint observes frontiers, metres."""
        return self.sensor_range if self.utility_range is None else self.utility_range

    def with_planning_set_of(self, other: MappingConfig) -> MappingConfig:
        """Return this mapping with the utilities and beacons of another: in its share of the sensor range, and by its
        metres of frontier.
        """
        scale = self.sensor_range / other.sensor_range
        cells = other.resolution / self.resolution
        return self.model_copy(
            update={
                "utility_range": None if other.utility_range is None else scale * other.utility_range,
                "min_utility": max(1, round(cells * other.min_utility)),
                "least_utility": max(1, round(cells * other.least_utility)),
                "beacon_range": scale * other.beacon_range,
            }
        )

    @model_validator(mode="after")
    def _spacing_fits_resolution(self) -> MappingConfig:
        if self.viewpoint_spacing < 2 * self.resolution:
            raise ValueError(
                f"viewpoint_spacing ({self.viewpoint_spacing} m) must be at least two belief cells "
                f"(2 x {self.resolution} m): raise viewpoint_spacing or lower resolution"
            )
        return self


class FamilyConfig(Section):
    """A family of worlds in a mix, and what is drawn anew for each of its episodes."""

    name: str
    """Its name, for reports. Lower-case letters, digits and dashes."""
    train: tuple[str, ...] = ()
    """Sources of its training worlds; those of `maps` when not given."""
    validation: tuple[str, ...] = ()
    """Likewise of its validation worlds."""
    tasks: tuple[str, ...] = ()
    """Tasks that it serves, where the run has them; all of the run when not given."""
    teacher: Literal["expert", "reference", "policy"] = "expert"
    """Whom imitation follows here: `expert`: who knows the true map; `reference`: the route of a classical planner, for
    worlds where that is the better beginning; `policy`: `learner.initial_policy`, so that what it can is kept."""
    share: Positive = 1.0
    """Its share of all steps, in proportion to the other families'."""
    sensor_range: tuple[Positive, Positive] | None = None
    """Range of the sensor, drawn between two bounds, metres; `mapping.sensor_range` when not given. Utilities and
    beacons keep their share of it."""
    viewpoint_spacing: tuple[Positive, Positive] | None = None
    """Likewise the distance between neighbouring viewpoints, metres."""
    robot_radius: tuple[Annotated[float, Field(ge=0.0)], Annotated[float, Field(ge=0.0)]] | None = None
    """Likewise the radius of the robot, metres."""
    max_steps: Annotated[int, Field(ge=1, le=10_000)] | None = None
    """Each world's own limit of decisions, by its size, and at most this; `task.max_steps` when not given."""
    unseen_area: Annotated[float, Field(ge=0.0)] | None = None
    """As `task.unseen_area`, which holds when this is not given."""

    @field_validator("name")
    @classmethod
    def _name_is_an_id(cls, value: str) -> str:
        if not ID_PATTERN.fullmatch(value):
            raise ValueError("use 1 to 64 lower-case letters, digits and dashes, such as 'office-2'")
        return value

    @field_validator("sensor_range", "viewpoint_spacing", "robot_radius")
    @classmethod
    def _bounds_ascend(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[0] > value[1]:
            raise ValueError(f"the lower bound comes first: write [{value[1]:g}, {value[0]:g}]")
        return value

    def serves(self, task: str) -> bool:
        """Whether it has episodes of a task."""
        return not self.tasks or task in self.tasks


class SimulatorConfig(Section):
    """The simulated robot and its sensor."""

    name: str = "pybullet"
    """`pybullet`: a physics world of wall meshes; `grid`: pure 2D ray traversal, needs no PyBullet; or one that an
    installed package adds, or MODULE:CLASS."""
    fidelity: Literal["kinematic", "dynamic"] = "kinematic"
    """PyBullet only. `kinematic`: carried along the segment; `dynamic`: wheels, motors, contacts."""
    rays: Annotated[int, Field(ge=16, le=7200)] = 720
    """Beams per scan over the full circle."""
    sense_every: Positive | None = None
    """Also scan along the way, every so many metres; by default only at waypoints (the paper's protocol)."""
    speed: Positive = 2.0
    """Driving speed, m/s."""
    range_noise: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of the range noise, metres."""
    lidar_rate: Positive = 10.0
    """Scans per simulated second while driving in dynamic fidelity, Hz."""
    lidar_layers: Literal[1, 16] = 1
    """PyBullet only: 1 for a planar lidar, 16 for a 3D lidar whose returns are projected to the plane."""
    wall_height: Positive = 2.0
    """Height of the walls in PyBullet, metres."""


class TaskConfig(Section):
    """What the robot must do, and when an episode ends."""

    name: str = EXPLORATION.name
    """`exploration`: map everything reachable; `navigation`: reach the target; or one that an installed package adds,
    or MODULE:NAME of a task of one's own."""
    max_steps: Annotated[int, Field(ge=1, le=10_000)] = 128
    """Decisions per episode; reaching the limit truncates the episode (no terminal state)."""
    unseen_area: Annotated[float, Field(ge=0.0)] = 15.625
    """Exploration is complete when at most this much reachable free area is unseen, m² (250 px of 0.25 m)."""
    arrival_radius: Positive = 1.6
    """Navigation is complete within this distance of the target, metres, or inside its marker."""

    @property
    def kind(self) -> Task:
        """The task itself; ConfigError when there is none of that name."""
        return find_task(self.name)


class RewardConfig(Section):
    """The reward of both tasks."""

    kind: Literal["paper", "potential"] = "paper"
    """`paper`: travelled distance, observed frontiers, finish bonus; `potential`: the privileged expert's remaining
    distance T as potential, (T(s) - T(s') - d) / scale, for training only."""
    frontier_weight: Annotated[float, Field(ge=0.0)] = 1.0
    """paper: weight of the frontier that the step removed, in units of `frontier_scale`."""
    frontier_scale: Positive = 50.0
    """paper: metres of removed frontier that earn `frontier_weight` (the family's 50 frontiers on a 1 m grid)."""
    distance_weight: Annotated[float, Field(ge=0.0)] = 1.0
    """paper: weight of the travelled distance, in units of `distance_scale`."""
    distance_scale: Positive = 16.0
    """paper: metres of travel that cost `distance_weight` (the family's 64 px at 0.25 m/px)."""
    progress_weight: Annotated[float, Field(ge=0.0)] = 0.0
    """paper: weight of the straight-line progress towards the target, in units of `distance_scale` (navigation)."""
    finish_bonus: Annotated[float, Field(ge=0.0)] = 20.0
    """paper: added when the task is complete."""
    potential_scale: Positive = 4.0
    """potential: metres per unit of reward."""


class NetworkConfig(Section):
    """Encoder, beacon decoder and waypoint decoder (paper, section IV)."""

    variant: Literal["vanilla", "hierarchical", "hdplanner"] = "hdplanner"
    """`vanilla`: waypoint decoder alone; `hierarchical`: beacon, then waypoint; `hdplanner`: with contrastive loss."""
    width: Annotated[int, Field(ge=8, le=1024)] = 128
    """d, the size of a node feature."""
    heads: Annotated[int, Field(ge=1, le=64)] = 8
    """Attention heads; must divide the width."""
    layers: Annotated[int, Field(ge=1, le=24)] = 6
    """Encoder layers."""
    feedforward: Annotated[int, Field(ge=1, le=8)] = 4
    """Hidden size of a feed-forward block, as a multiple of the width."""
    features: Literal["paper", "extended", "guided"] = "extended"
    """Node features: `paper`: position, utility, visited, beacon, target; `extended`: also graph distance from the
    robot, degree, distance to the nearest useful viewpoint, on a shortest path to a beacon, all from the belief;
    `guided`: also where a classical planner would go (`tour` in exploration, D* Lite in navigation), the range of the
    sensor, and frontiers by length instead of cells."""
    graph: Literal["full", "reduced", "tokens"] = "full"
    """Nodes that the network reads: all reachable ones; or only those near the robot, useful ones, beacons and the
    shortest paths to them, about half as many on public maps; or `tokens`: the same up to 128 nodes, where there are
    more, useful ones and paths near the robot alone. The last needs the features `guided`."""
    toward: bool = False
    """Tell the waypoint decoder which waypoints lie on a shortest path to which beacon, as a bias of its logits."""

    @model_validator(mode="after")
    def _tokens_are_guided(self) -> NetworkConfig:
        if self.graph == "tokens" and self.features != "guided":
            raise ValueError("graph 'tokens' needs what the features 'guided' tell: set network.features to 'guided'")
        return self

    @model_validator(mode="after")
    def _heads_divide_width(self) -> NetworkConfig:
        if self.width % self.heads:
            raise ValueError(f"heads ({self.heads}) must divide width ({self.width}): choose for example 4 or 8 heads")
        return self


class AdamConfig(Section):
    """Learning rates and their schedule."""

    policy: Positive = 2e-4
    """Peak learning rate of the policy."""
    critic: Positive = 3e-4
    """Peak learning rate of the critics."""
    temperature: Positive = 1e-3
    """Learning rate of both log temperatures."""
    schedule: Literal["constant", "linear", "cosine"] = "constant"
    """Course of policy and critic rates from their peak to `final_fraction` of it over `learner.total_updates`."""
    warmup_updates: Annotated[int, Field(ge=0)] = 0
    """Updates over which the rates rise linearly from 0."""
    final_fraction: Fraction = 0.1
    """Share of the peak rate left at the end of a linear or cosine schedule."""


class SacConfig(Section):
    """Discrete soft actor-critic over pairs of beacon and waypoint (paper, section IV; docs/design.md)."""

    gamma: Fraction = 0.99
    """Discount factor."""
    n_step: Annotated[int, Field(ge=1, le=64)] = 1
    """Rewards that a critic's target sums before it bootstraps."""
    target_update: Literal["hard", "soft"] = "hard"
    """`hard`: copy the critics every `target_interval` updates; `soft`: moving average at rate `target_rate`."""
    target_interval: Annotated[int, Field(ge=1)] = 256
    """Updates between two hard copies."""
    target_rate: Fraction = 0.005
    """Moving-average rate of soft target updates."""
    target_entropy: Fraction = 0.05
    """Target entropy of each decision as a fraction of log(number of valid choices)."""
    initial_temperature: Positive = 0.1
    """Both temperatures at the start."""
    learn_temperature: bool = True
    """Tune the temperatures to the target entropy; otherwise they stay at `initial_temperature`."""
    critic_only_updates: Annotated[int, Field(ge=0)] = 0
    """First updates that train only the critics, for a policy that starts from imitation."""
    privileged_critic: bool = False
    """The critics are told what the true map makes of each waypoint, the expert's detour, which is the next reward with
    the `potential` reward; they learn only what comes after it. The policy stays as it is. Actors label every step."""
    huber_delta: Positive | None = 10.0
    """Critic loss: Huber with this delta, or plain squared error when null."""
    clip_norm: Positive = 10.0
    """Gradients of policy and critics are clipped to this norm each."""


class PpoConfig(Section):
    """Proximal policy optimisation of what comes beyond the exact sum of the expert's detours, on recent steps."""

    gamma: Fraction = 0.97
    """Discount factor."""
    n_step: Annotated[int, Field(ge=1, le=64)] = 8
    """Rewards that a return sums before the value function takes over."""
    window: Annotated[int, Field(ge=1)] = 4096
    """Newest transitions that returns are drawn from: older ones are too far from the present policy."""
    rehearsal: Annotated[float, Field(ge=0.0, le=0.9)] = 1 / 3
    """Share of a batch that is drawn from all labelled steps instead and serves imitation alone, so that no family of
    worlds is forgotten."""
    clip: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.2
    """The ratio of new to old probability of a waypoint earns nothing beyond 1 - clip and 1 + clip."""
    imitation_weight: Annotated[float, Field(ge=0.0)] = 0.1
    """Weight of the imitation loss beside the exact sum and the clipped loss, in each family after its own teacher."""
    max_advantage: Positive = 4.0
    """Advantages beyond this many standard deviations of their family of worlds count as this."""
    scale_rate: Annotated[float, Field(gt=0.0, le=1.0)] = 0.002
    """Weight of one new advantage in the running mean and standard deviation of its family."""
    value: Positive = 5e-3
    """Learning rate of the value function, constant."""
    value_only_updates: Annotated[int, Field(ge=0)] = 100
    """First updates after imitation that train only the value function."""
    huber_delta: Positive = 4.0
    """Errors of the value function above this count linearly, in units of reward."""
    clip_norm: Positive = 1.0
    """Gradients of policy and value function are clipped to this norm each."""


class ContrastiveConfig(Section):
    """Contrastive joint optimisation (Algorithm 2); used by the variant `hdplanner` alone."""

    weight: Annotated[float, Field(ge=0.0)] = 0.1
    """Weight of the triplet loss beside the policy loss."""
    margin: Positive = 0.5
    """m of the triplet hinge."""
    epsilon: Fraction = 0.5
    """Probability that the positive comes from the Q network, else from the target Q network; with `ppo` from the
    returns, else from the expert's detours alone."""
    beacons: bool = False
    """Apply the loss to beacons too."""


class CloningConfig(Section):
    """Imitation of a privileged expert (DAgger), before or beside reinforcement learning."""

    updates: Annotated[int, Field(ge=0)] = 0
    """First updates that only imitate the expert; 0 switches the stage off."""
    anchor_weight: Annotated[float, Field(ge=0.0)] = 0.0
    """Weight of the imitation loss beside the policy loss of `sac` after that stage; 0 switches it off. With `ppo` it
    is part of the loss, at weight 1."""
    learning_rate: Positive = 6e-4
    """Learning rate of the policy during the stage."""
    expert_episodes: Fraction = 0.3
    """Share of training episodes that the expert drives during the stage; the policy drives the others."""
    cross_entropy_weight: Annotated[float, Field(ge=0.0)] = 0.1
    """Weight of the cross entropy on softmax(-cost) beside the expected cost."""
    beacon_weight: Annotated[float, Field(ge=0.0)] = 0.1
    """Weight of the cross entropy on the expert's first beacon."""
    entropy_bonus: Annotated[float, Field(ge=0.0)] = 0.003
    """Weight of the policy's entropy, subtracted from the loss."""
    cost_scale: Positive = 4.0
    """Metres of detour per unit of cost."""
    max_cost: Positive = 10.0
    """Costs above this many units count as this."""

    @property
    def enabled(self) -> bool:
        """Whether actors must label their states."""
        return self.updates > 0 or self.anchor_weight > 0.0


class ReplayConfig(Section):
    """The replay buffer."""

    capacity: Annotated[int, Field(ge=100)] = 100_000
    """Transitions held at most; the oldest go first."""
    max_bytes: Annotated[int, Field(ge=30_000_000)] = 500_000_000
    """Memory held at most, bytes."""
    min_steps: Annotated[int, Field(ge=1)] = 2_000
    """Steps to collect before the first update."""


class LearnerConfig(Section):
    """The training loop."""

    batch_size: Annotated[int, Field(ge=1, le=4096)] = 64
    """Transitions per update."""
    updates_per_step: Positive = 0.0625
    """Declared ratio of updates to collected steps: the learner waits, or holds the actors, to keep it."""
    ratio_tolerance: Annotated[int, Field(ge=1)] = 4_000
    """Collected steps that the actors may run ahead of the declared ratio before they are held."""
    total_updates: Annotated[int, Field(ge=1)] = 20_000
    """Updates after which the run is complete."""
    initial_policy: str | None = None
    """Begin from these weights (.safetensors with card) instead of random ones: to train on for one's own worlds."""
    device: str = "auto"
    """`auto` (CUDA when present), `cpu`, `cuda` or `cuda:N`."""
    precision: Literal["auto", "fp32", "bf16"] = "auto"
    """`auto`: bfloat16 autocast on a CUDA device that has it, fp32 elsewhere."""
    threads: Annotated[int, Field(ge=0)] = 0
    """Torch threads on the CPU; 0 for the cores that local actors leave, at least 1."""
    augment: bool = True
    """Eight-fold symmetry augmentation of every sampled observation pair; with `ppo` of those that serve imitation."""
    publish_every: Annotated[int, Field(ge=1)] = 10
    """Updates between two published policy versions."""
    average_decay: Fraction = 0.99
    """Moving average of the policy's weights that evaluation and export use; 0 switches it off."""
    evaluators: tuple[str, ...] = ()
    """Hosts whose evaluators choose the best policy, besides those that the learner starts itself: the names of their
    certificates, or what stands before the number in the names of their actors. Where none is named and there is no
    `bus.tls_access`, every evaluator counts."""


class CheckpointConfig(Section):
    """Checkpoints."""

    every_seconds: Positive = 300.0
    """Seconds between two checkpoints."""
    keep: Annotated[int, Field(ge=2)] = 3
    """Newest checkpoints kept beside the best one; at least two, so that a damaged one has a predecessor."""
    replay: bool = True
    """Save the replay buffer too, so that resuming continues with the same data."""


class JournalConfig(Section):
    """The journal of what actors deliver."""

    acknowledge: Literal["disk", "memory"] = "disk"
    """When a delivery is acknowledged: once it is on the disk, so that a power failure loses nothing that was
    acknowledged, or at once, so that it may lose what came within the last `sync_seconds`. The death of the learner's
    process loses nothing either way."""
    sync_seconds: Annotated[float, Field(gt=0.0, le=1.0)] = 0.05
    """Least time between two syncs of the disk; all deliveries that come meanwhile share one. Much below
    `bus.ack_timeout`, after which actors send again."""


class TrackingConfig(Section):
    """Where the curves go besides TensorBoard."""

    writers: tuple[Literal["mlflow", "wandb"], ...] = ()
    """Trackers that get every curve too: `mlflow`, `wandb` (Weights & Biases); each is an extra of that name."""
    project: str = "hdplanner"
    """Experiment of MLflow, project of Weights & Biases."""
    mlflow_uri: str | None = None
    """MLflow's store, such as `http://server:5000`; by default the database `mlflow.db` in the folder of all runs."""


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


class RunConfig(Section):
    """A whole run."""

    name: str = "default"
    """Name of the run: its folder, and its prefix on the bus. Lower-case letters, digits and dashes."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of networks, sampling and worlds."""
    maps: MapsConfig = Field(default_factory=MapsConfig)
    """Where worlds come from."""
    families: tuple[FamilyConfig, ...] = ()
    """A mix of families of worlds; when not given, the worlds of `maps` alone."""
    mapping: MappingConfig = Field(default_factory=MappingConfig)
    """Belief, viewpoint graph, utility and beacons."""
    simulator: SimulatorConfig = Field(default_factory=SimulatorConfig)
    """The simulated robot; an actor may override it."""
    task: TaskConfig = Field(default_factory=TaskConfig)
    """What the robot must do."""
    both_tasks: bool = False
    """Train one policy for both tasks, with half of all steps each, whatever `task.name` says."""
    reward: RewardConfig = Field(default_factory=RewardConfig)
    """The reward."""
    network: NetworkConfig = Field(default_factory=NetworkConfig)
    """The policy's and the critics' networks."""
    adam: AdamConfig = Field(default_factory=AdamConfig)
    """Learning rates."""
    algorithm: Literal["sac", "ppo"] = "sac"
    """What follows the imitation stage: `sac`: soft actor-critic; `ppo`: on-policy returns on top of the exact sum of
    the expert's detours, which needs the `potential` reward. Only the section of that name counts."""
    sac: SacConfig = Field(default_factory=SacConfig)
    """Soft actor-critic."""
    ppo: PpoConfig = Field(default_factory=PpoConfig)
    """Proximal policy optimisation."""
    contrastive: ContrastiveConfig = Field(default_factory=ContrastiveConfig)
    """Contrastive joint optimisation."""
    cloning: CloningConfig = Field(default_factory=CloningConfig)
    """Imitation stage."""
    replay: ReplayConfig = Field(default_factory=ReplayConfig)
    """Replay buffer."""
    learner: LearnerConfig = Field(default_factory=LearnerConfig)
    """Training loop."""
    checkpoints: CheckpointConfig = Field(default_factory=CheckpointConfig)
    """Checkpoints."""
    journal: JournalConfig = Field(default_factory=JournalConfig)
    """The journal."""
    tracking: TrackingConfig = Field(default_factory=TrackingConfig)
    """Trackers of experiments."""
    actor: ActorConfig = Field(default_factory=ActorConfig)
    """Actors."""
    bus: BusConfig = Field(default_factory=BusConfig)
    """The bus."""

    @field_validator("name")
    @classmethod
    def _name_is_an_id(cls, value: str) -> str:
        if not ID_PATTERN.fullmatch(value):
            raise ValueError("use 1 to 64 lower-case letters, digits and dashes, such as 'office-2'")
        return value

    @model_validator(mode="after")
    def _privileged_critic_has_its_reward(self) -> RunConfig:
        if self.sac.privileged_critic and self.reward.kind != "potential":
            raise ValueError(
                "sac.privileged_critic needs the reward that it is told in advance: set reward.kind to 'potential'"
            )
        return self

    @model_validator(mode="after")
    def _ppo_has_its_reward(self) -> RunConfig:
        if self.algorithm == "ppo" and self.reward.kind != "potential":
            raise ValueError(
                "algorithm 'ppo' learns what the expert's detours leave of the reward: set reward.kind to 'potential'"
            )
        return self

    @model_validator(mode="after")
    def _families_fit(self) -> RunConfig:
        names = [family.name for family in self.families]
        if len(set(names)) < len(names) or len(names) > MAX_FAMILIES:
            raise ValueError(f"families: give each of up to {MAX_FAMILIES} families a name of its own, got {names}")
        for family in self.families:
            spacing = family.viewpoint_spacing
            if spacing is not None and spacing[0] < 2 * self.mapping.resolution:
                raise ValueError(
                    f"families: viewpoint_spacing of {family.name!r} must be at least two belief cells "
                    f"(2 x {self.mapping.resolution} m), got {spacing[0]}"
                )
        teachers = {family.teacher for family in self.families}
        if "policy" in teachers and self.learner.initial_policy is None:
            raise ValueError("families: one has the teacher 'policy': name it with learner.initial_policy")
        if "reference" in teachers and self.network.features != "guided":
            raise ValueError(
                "families: one has the teacher 'reference', whose route only network.features = 'guided' tell"
            )
        for task in self.tasks:
            if not any(family.serves(task.name) for family in self.mix):
                raise ValueError(f"families: one of them at least must serve the task {task.name!r}: see their `tasks`")
        return self

    @property
    def mix(self) -> tuple[FamilyConfig, ...]:
        """The families of worlds; without any that of `maps`."""
        return self.families or (FamilyConfig(name="worlds"),)

    @property
    def training_sources(self) -> tuple[str, ...]:
        """The sources of all training worlds, each once."""
        every = (
            source
            for task in self.tasks
            for family in self.mix
            if family.serves(task.name)
            for source in self.sources(family, task.name, evaluate=False)
        )
        return tuple(dict.fromkeys(every))

    @property
    def mapping_ranges(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest value in training of what families draw anew: settings of `mapping` by name."""
        ranges = {}
        for name in ("sensor_range", "viewpoint_spacing", "robot_radius"):
            own = getattr(self.mapping, name)
            bounds = [getattr(family, name) or (own, own) for family in self.mix]
            ranges[name] = min(low for low, _ in bounds), max(high for _, high in bounds)
        return ranges

    def sources(self, family: FamilyConfig, task: str, *, evaluate: bool) -> tuple[str, ...]:
        """Return the sources of a family's worlds for episodes of a task; empty where it has none for validation.

        Args:
            family: one of `mix`.
            task: name of the task.
            evaluate: those of validation.
        """
        own = family.validation if evaluate else family.train
        if own or family.train:
            return own
        maps = self.maps
        if find_task(task).needs_target:
            navigation = maps.validation_navigation if evaluate else maps.train_navigation
            if navigation:
                return navigation
        return maps.validation if evaluate else maps.train

    @property
    def labelled(self) -> bool:
        """Whether every training step carries the privileged expert's labels, after the imitation stage too."""
        if self.algorithm == "ppo":
            return True
        return self.cloning.anchor_weight > 0.0 or self.sac.privileged_critic

    @property
    def tasks(self) -> tuple[TaskConfig, ...]:
        """The tasks of its episodes."""
        names = [task.name for task in BOTH] if self.both_tasks else [self.task.name]
        return tuple(self.task.model_copy(update={"name": name}) for name in names)

    @property
    def task_name(self) -> str:
        """What its policy is for: the name of its task, or ``both``."""
        return "both" if self.both_tasks else self.task.kind.name

    @property
    def contrastive_weight(self) -> float:
        """Weight of the contrastive loss for this variant: zero without it."""
        return self.contrastive.weight if self.network.variant == "hdplanner" else 0.0
