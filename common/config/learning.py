"""How the policy learns: imitation, reinforcement, their losses and the training loop."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from common.config.section import Fraction, Positive, Section


class AdamConfig(Section):
    """Learning rates and their schedule."""

    policy: Positive = 2e-4
    """Peak learning rate of the policy."""
    critic: Positive = 3e-4
    """Peak learning rate of the critics."""
    temperature: Positive = 1e-3
    """Learning rate of both log temperatures."""
    schedule: Literal["constant", "linear", "cosine"] = "constant"
    """How the rates of policy and critics fall from their peak to `final_fraction` of it over
    `learner.total_updates`."""
    warmup_updates: Annotated[int, Field(ge=0)] = 0
    """Updates over which the rates rise linearly from 0."""
    final_fraction: Fraction = 0.1
    """Fraction of the peak rate at the end of a linear or cosine schedule."""


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
    """Initial value of both temperatures."""
    learn_temperature: bool = True
    """Tune the temperatures to the target entropy; otherwise they stay at `initial_temperature`."""
    critic_only_updates: Annotated[int, Field(ge=0)] = 0
    """Updates that train only the critics at the start, for a policy that starts from imitation."""
    privileged_critic: bool = False
    """Give the critics the expert's detour for each waypoint, computed on the true map. With the `potential` reward
    this is the next reward, so they learn only what follows it. The policy gets no privileged input. Actors label every
    step."""
    huber_delta: Positive | None = 10.0
    """Critic loss: Huber with this delta, or plain squared error when null."""
    clip_norm: Positive = 10.0
    """Gradient clipping norm, separately for policy and critics."""


class PpoConfig(Section):
    """Proximal policy optimisation on recent steps, of what the exact sum of the expert's detours leaves out."""

    gamma: Fraction = 0.97
    """Discount factor."""
    n_step: Annotated[int, Field(ge=1, le=64)] = 8
    """Rewards that a return sums before it bootstraps from the value function."""
    window: Annotated[int, Field(ge=1)] = 4096
    """Returns are drawn from this many of the newest transitions; older ones are too off-policy."""
    rehearsal: Annotated[float, Field(ge=0.0, le=0.9)] = 1 / 3
    """Share of each batch drawn from all labelled steps and used for imitation only, so that no family of worlds is
    forgotten."""
    clip: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.2
    """Clip range: the ratio of new to old probability of a waypoint is clipped to 1 ± this."""
    imitation_weight: Annotated[float, Field(ge=0.0)] = 0.1
    """Weight of the imitation loss next to the exact sum and the clipped loss; each family follows its own teacher."""
    max_advantage: Positive = 4.0
    """Advantages are clipped at this many standard deviations of their family of worlds."""
    scale_rate: Annotated[float, Field(gt=0.0, le=1.0)] = 0.002
    """Weight of a new advantage in the running mean and standard deviation of its family."""
    value: Positive = 5e-3
    """Learning rate of the value function, constant."""
    value_only_updates: Annotated[int, Field(ge=0)] = 100
    """Updates that train only the value function, right after imitation."""
    huber_delta: Positive = 4.0
    """Huber delta of the value loss, in units of reward."""
    clip_norm: Positive = 1.0
    """Gradient clipping norm, separately for policy and value function."""


class ContrastiveConfig(Section):
    """Contrastive joint optimisation (Algorithm 2); used only by the variant `hdplanner`."""

    weight: Annotated[float, Field(ge=0.0)] = 0.1
    """Weight of the triplet loss relative to the policy loss."""
    margin: Positive = 0.5
    """m of the triplet hinge."""
    epsilon: Fraction = 0.5
    """Probability that the positive is chosen by the Q network rather than the target Q network; with `ppo`, by the
    returns rather than the expert's detours alone."""
    beacons: bool = False
    """Apply the loss to beacons too."""


class CloningConfig(Section):
    """Imitation of a privileged expert (DAgger), before or alongside reinforcement learning."""

    updates: Annotated[int, Field(ge=0)] = 0
    """Updates of the imitation stage, at the start of the run; 0 skips it."""
    anchor_weight: Annotated[float, Field(ge=0.0)] = 0.0
    """Weight of the imitation loss relative to the policy loss of `sac` after that stage; 0 disables it. `ppo` has
    `ppo.imitation_weight` instead."""
    learning_rate: Positive = 6e-4
    """Learning rate of the policy during the imitation stage."""
    expert_episodes: Fraction = 0.3
    """Share of training episodes driven by the expert during the stage; the policy drives the rest."""
    cross_entropy_weight: Annotated[float, Field(ge=0.0)] = 0.1
    """Weight of the cross entropy on softmax(-cost) relative to the expected cost."""
    beacon_weight: Annotated[float, Field(ge=0.0)] = 0.1
    """Weight of the cross entropy on the expert's first beacon."""
    entropy_bonus: Annotated[float, Field(ge=0.0)] = 0.003
    """Weight of the policy's entropy, subtracted from the loss."""
    route_share: Fraction = 0.85
    """Probability of the first viewpoint of the reference route in families whose teacher is the `reference`; the rest
    is the expert's, so that there is something to learn from. Less is a softer start for reinforcement learning."""
    cost_scale: Positive = 4.0
    """Metres of detour per unit of cost."""
    max_cost: Positive = 10.0
    """Costs are clipped at this many units."""

    auxiliary_weight: Annotated[float, Field(ge=0.0)] = 0.0
    """Weight of what the network learns to foresee besides, wherever the imitation loss counts: the free space beyond
    frontiers, and what each viewpoint would show. The actors' simulators tell; needs `network.belief_map`. 0 leaves it
    out."""

    @property
    def enabled(self) -> bool:
        """Whether actors must label their states."""
        return self.updates > 0 or self.anchor_weight > 0.0


class LearnerConfig(Section):
    """The training loop."""

    batch_size: Annotated[int, Field(ge=1, le=4096)] = 64
    """Transitions per update."""
    updates_per_step: Positive = 0.0625
    """Target ratio of updates to collected steps: the learner waits, or pauses the actors, to hold it."""
    ratio_tolerance: Annotated[int, Field(ge=1)] = 4_000
    """Steps that the actors may collect beyond that ratio before they are paused."""
    total_updates: Annotated[int, Field(ge=1)] = 20_000
    """The run is complete after this many updates."""
    initial_policy: str | None = None
    """Start from these weights (.safetensors with its card) instead of random ones, for fine-tuning; `exploration` or
    `navigation` names the policy that is shipped for the task."""
    device: str = "auto"
    """`auto` (CUDA if available), `cpu`, `cuda` or `cuda:N`."""
    precision: Literal["auto", "fp32", "bf16"] = "auto"
    """`auto`: bfloat16 autocast on GPUs and processors that have instructions for it, fp32 elsewhere."""
    compile: bool = False
    """Compile the encoder's layers with `torch.compile`, for GPUs: the learner then starts up to two minutes later, and
    an update is fewer and larger kernels. On CPUs it gains little or nothing (docs/speed.md)."""
    threads: Annotated[int, Field(ge=0)] = 0
    """CPU threads for torch; 0 for the cores not used by local actors, at least 1."""
    augment: bool = True
    """Augment each sampled observation pair with the eight symmetries of the square; `ppo` augments only those used for
    imitation."""
    publish_every: Annotated[int, Field(ge=1)] = 10
    """Updates between published policy versions, at least."""
    publish_seconds_per_actor: Annotated[float, Field(ge=0.0, le=1.0)] = 0.01
    """Seconds between them, at least, for each actor and evaluator that fetches them. Handing a version to one of them
    takes the learner about a millisecond: 0.01 keeps that below about a tenth of a core for any number of them (10 s
    for 1,000); 0 publishes by the number of updates alone."""
    average_decay: Fraction = 0.99
    """Decay of the moving average of the policy's weights used for evaluation and export; 0 disables averaging."""
    evaluators: tuple[str, ...] = ()
    """Hosts whose evaluators choose the best policy, in addition to those started by the learner: names of their
    certificates, or the part before the number in their actors' names. If none is named and `bus.tls_access` is not
    set, every evaluator counts."""
