"""The configuration of a run: schema, loading with precedence, description."""

from common.config.load import load_config, preset_names, resolve
from common.config.schema import (
    ActorConfig,
    AdamConfig,
    BusConfig,
    CheckpointConfig,
    CloningConfig,
    ContrastiveConfig,
    LearnerConfig,
    MappingConfig,
    MapsConfig,
    NetworkConfig,
    ReplayConfig,
    RewardConfig,
    RunConfig,
    SacConfig,
    SimulatorConfig,
    TaskConfig,
)

__all__ = [
    "ActorConfig",
    "AdamConfig",
    "BusConfig",
    "CheckpointConfig",
    "CloningConfig",
    "ContrastiveConfig",
    "LearnerConfig",
    "MappingConfig",
    "MapsConfig",
    "NetworkConfig",
    "ReplayConfig",
    "RewardConfig",
    "RunConfig",
    "SacConfig",
    "SimulatorConfig",
    "TaskConfig",
    "load_config",
    "preset_names",
    "resolve",
]
