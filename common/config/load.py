"""Loading of a run's configuration: preset, file, environment, command line; the later one wins."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo

from common.config.names import named_parts
from common.config.run import RunConfig
from common.config.tree import ConfigTree
from common.presets import RUN_PRESETS

RUN = ConfigTree(
    RunConfig,
    subject="run",
    presets=RUN_PRESETS,
    preset_word="preset",
    prefix="HD_",
    example="learner.batch_size=32",
    command="hd-learner config --describe",
    names=named_parts,
)
"""The tree of a run; the robot's bridge has one of its own."""


def preset_names() -> list[str]:
    """Names of the presets that ship with the package."""
    return RUN.preset_names()


def load_config(
    file: Path | None = None,
    overrides: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    preset: str | None = None,
) -> RunConfig:
    """Resolve the configuration of a run; see `ConfigTree.load`."""
    return RUN.load(file, overrides, environment, preset)


def resolve(tree: Mapping[str, Any], origin: Mapping[str, str] | None = None) -> RunConfig:
    """Validate a plain tree of settings, such as a run's spec; see `ConfigTree.resolve`."""
    return RUN.resolve(tree, origin)


def all_fields() -> Iterator[tuple[str, FieldInfo]]:
    """Yield every setting of a run as (dotted path, field)."""
    return RUN.all_fields()
