"""The configuration of a run: its sections, loading with precedence, description. Everybody imports from here."""

from common.config.bus import ActorConfig, BusConfig
from common.config.learning import AdamConfig, CloningConfig, ContrastiveConfig, LearnerConfig, PpoConfig, SacConfig
from common.config.load import load_config, preset_names, resolve
from common.config.network import ImageScale, NetworkConfig
from common.config.run import RunConfig
from common.config.section import Fraction, Positive, Section
from common.config.storage import CheckpointConfig, JournalConfig, ReplayConfig, TrackingConfig
from common.config.task import RewardConfig, TaskConfig
from common.config.worlds import FamilyConfig, MappingConfig, MapsConfig, SimulatorConfig

__all__ = [
    "ActorConfig",
    "AdamConfig",
    "BusConfig",
    "CheckpointConfig",
    "CloningConfig",
    "ContrastiveConfig",
    "FamilyConfig",
    "Fraction",
    "ImageScale",
    "JournalConfig",
    "LearnerConfig",
    "MappingConfig",
    "MapsConfig",
    "NetworkConfig",
    "Positive",
    "PpoConfig",
    "ReplayConfig",
    "RewardConfig",
    "RunConfig",
    "SacConfig",
    "Section",
    "SimulatorConfig",
    "TaskConfig",
    "TrackingConfig",
    "load_config",
    "preset_names",
    "resolve",
]
