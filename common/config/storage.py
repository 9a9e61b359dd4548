"""What the learner keeps: replay buffer, checkpoints, journal, and curves."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from common.config.section import Seconds, Section


class ReplayConfig(Section):
    """The replay buffer."""

    capacity: Annotated[int, Field(ge=100)] = 100_000
    """Maximum number of transitions; the oldest are evicted first."""
    max_bytes: Annotated[int, Field(ge=30_000_000)] = 500_000_000
    """Maximum memory, bytes."""
    min_steps: Annotated[int, Field(ge=1)] = 2_000
    """Steps to collect before the first update."""


class CheckpointConfig(Section):
    """Checkpoints."""

    every_seconds: Seconds = 300.0
    """Interval between checkpoints, seconds."""
    keep: Annotated[int, Field(ge=2)] = 3
    """Newest checkpoints to keep in addition to the best one; at least two, in case one is damaged."""
    mirror: str | None = None
    """Folder of runs at a URL, such as `s3://bucket/runs`, that gets a copy of every checkpoint (extra `storage`): a
    learner on another machine continues from there by `hd-learner resume --from`. The journal stays on the local
    disk."""
    replay: bool = True
    """Save the replay buffer too, so that resuming continues with the same data."""


class JournalConfig(Section):
    """The journal of everything that actors deliver."""

    acknowledge: Literal["disk", "memory"] = "disk"
    """When a delivery is acknowledged. `disk`: once it is synced, so that a power failure loses nothing acknowledged.
    `memory`: at once; a power failure may lose the last `sync_seconds`. A crash of the learner process loses nothing
    either way."""
    sync_seconds: Annotated[float, Field(gt=0.0, le=1.0)] = 0.05
    """Minimum time between syncs; all deliveries in between share one. Keep it far below `bus.ack_timeout`, after which
    actors resend."""


class TrackingConfig(Section):
    """Where learning curves go in addition to TensorBoard."""

    writers: tuple[Literal["mlflow", "wandb"], ...] = ()
    """Trackers that receive every curve: `mlflow`, `wandb` (Weights & Biases). Each needs the extra of that name."""
    project: str = "hdplanner"
    """Name of the MLflow experiment or the Weights & Biases project."""
    mlflow_uri: str | None = None
    """MLflow's tracking store, such as `http://server:5000`. Default: the database `mlflow.db` in the folder of all
    runs."""
