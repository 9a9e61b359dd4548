"""What the learner keeps: replay buffer, checkpoints, journal, and curves."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from common.config.section import Positive, Section


class ReplayConfig(Section):
    """The replay buffer."""

    capacity: Annotated[int, Field(ge=100)] = 100_000
    """Transitions held at most; the oldest go first."""
    max_bytes: Annotated[int, Field(ge=30_000_000)] = 500_000_000
    """Memory held at most, bytes."""
    min_steps: Annotated[int, Field(ge=1)] = 2_000
    """Steps to collect before the first update."""


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
