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
    route_share: Fraction = 0.85
    """Probability of the first viewpoint of the reference route in families whose teacher is the `reference`; the rest
    is the expert's, so that there is something to learn from. Less is a softer start for reinforcement learning."""
    cost_scale: Positive = 4.0
    """Metres of detour per unit of cost."""
    max_cost: Positive = 10.0
    """Costs above this many units count as this."""

    @property
    def enabled(self) -> bool:
        """Whether actors must label their states."""
        return self.updates > 0 or self.anchor_weight > 0.0


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
