"""The whole configuration tree of a run.

The text of a field is its documentation: `hd-learner config --describe` and docs/configuration.md are made from it.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from common.config.bus import ActorConfig, BusConfig
from common.config.learning import AdamConfig, CloningConfig, ContrastiveConfig, LearnerConfig, PpoConfig, SacConfig
from common.config.network import NetworkConfig
from common.config.section import Section
from common.config.storage import CheckpointConfig, JournalConfig, ReplayConfig, TrackingConfig
from common.config.task import RewardConfig, TaskConfig
from common.config.worlds import FamilyConfig, MappingConfig, MapsConfig, SimulatorConfig
from common.ids import ID_PATTERN
from common.tasks import BOTH, NAVIGATION, find_task

MAX_FAMILIES = 64


class RunConfig(Section):
    """A whole run."""

    name: str = "default"
    """Name of the run: its folder, and its prefix on the bus. Lower-case letters, digits and dashes."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    """Seed of networks, sampling and worlds."""
    maps: MapsConfig = Field(default_factory=MapsConfig)
    """Where worlds come from."""
    families: tuple[FamilyConfig, ...] = ()
    """Families of worlds to mix; by default the worlds of `maps` alone."""
    mapping: MappingConfig = Field(default_factory=MappingConfig)
    """Belief, viewpoint graph, utility and beacons."""
    simulator: SimulatorConfig = Field(default_factory=SimulatorConfig)
    """The simulated robot; an actor may override it."""
    task: TaskConfig = Field(default_factory=TaskConfig)
    """What the robot must do."""
    both_tasks: bool = False
    """Train one policy for both tasks, each with half of all steps, regardless of `task.name`."""
    reward: RewardConfig = Field(default_factory=RewardConfig)
    """The reward."""
    network: NetworkConfig = Field(default_factory=NetworkConfig)
    """The policy's and the critics' networks."""
    adam: AdamConfig = Field(default_factory=AdamConfig)
    """Learning rates."""
    algorithm: Literal["sac", "ppo"] = "sac"
    """Algorithm after the imitation stage. `sac`: soft actor-critic. `ppo`: on-policy returns on top of the exact sum
    of the expert's detours; needs `reward.kind` `potential`. Only the section of the chosen algorithm takes effect."""
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
                "sac.privileged_critic needs a reward that can be known in advance: set reward.kind to 'potential'"
            )
        return self

    @model_validator(mode="after")
    def _ppo_has_its_reward(self) -> RunConfig:
        if self.algorithm == "ppo" and self.reward.kind != "potential":
            raise ValueError(
                "algorithm 'ppo' needs the reward that is based on the expert's detours: set reward.kind to 'potential'"
            )
        return self

    @model_validator(mode="after")
    def _hints_are_read(self) -> RunConfig:
        if self.hinted and not (self.network.belief_map and (self.cloning.enabled or self.labelled)):
            raise ValueError(
                "cloning.auxiliary_weight teaches networks that read the belief as a map, by the expert's labels: set "
                "network.belief_map to true and cloning.updates to more than 0, or cloning.auxiliary_weight to 0"
            )
        return self

    @model_validator(mode="after")
    def _targets_are_seen(self) -> RunConfig:
        # Other tasks than the shipped ones are checked where they are loaded.
        targets = self.both_tasks or self.task.name == NAVIGATION.name
        if targets and not self.network.sees_target:
            raise ValueError(
                f"network.variant {self.network.variant!r} with network.features {self.network.features!r} is not told "
                "where a target is: train it for exploration, or choose other features"
            )
        return self

    @model_validator(mode="after")
    def _families_fit(self) -> RunConfig:
        names = [family.name for family in self.families]
        if len(set(names)) < len(names) or len(names) > MAX_FAMILIES:
            raise ValueError(f"families: expected at most {MAX_FAMILIES} families with unique names, got {names}")
        for family in self.families:
            spacing = family.viewpoint_spacing
            if spacing is not None and spacing[0] < 2 * self.mapping.resolution:
                raise ValueError(
                    f"families: viewpoint_spacing of {family.name!r} must be at least two belief cells "
                    f"(2 x {self.mapping.resolution} m), got {spacing[0]}"
                )
        teachers = {family.teacher for family in self.families}
        if "policy" in teachers and self.learner.initial_policy is None:
            raise ValueError("families: teacher 'policy' needs a policy: set learner.initial_policy")
        if "reference" in teachers and self.network.features != "guided":
            raise ValueError(
                "families: teacher 'reference' needs features that show its route: set network.features to 'guided'"
            )
        for task in self.tasks:
            if not any(family.serves(task.name) for family in self.mix):
                raise ValueError(f"families: none of them serves the task {task.name!r}: add it to the `tasks` of one")
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
        """Smallest and largest value in training of what families randomize: settings of `mapping` by name."""
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
    def hinted(self) -> bool:
        """Whether the expert's labels hold hints of what the robot cannot see yet."""
        return self.cloning.auxiliary_weight > 0.0

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
