"""The configuration of a bridge: profile, file, environment and command line, resolved into `DeployConfig`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from common.config.describe import to_markdown
from common.config.tree import ConfigTree
from common.planners.registry import PLANNERS
from common.registry import NamedPart
from common.tasks import TASKS
from deploy.config import DeployConfig


def named_parts(config: DeployConfig) -> Iterator[NamedPart]:
    """Yield every planner and task that a robot's configuration names."""
    decision = config.decision
    yield NamedPart("decision.task", TASKS, decision.task)
    yield NamedPart("decision.planner", PLANNERS, decision.planner)
    if decision.fallback is not None:
        yield NamedPart("decision.fallback", PLANNERS, decision.fallback)


DEPLOY = ConfigTree(
    DeployConfig,
    subject="robot",
    presets=Path(__file__).parent,
    preset_word="profile",
    prefix="HDROBOT_",
    example="decision.planner=tare",
    command="hd-deploy config --describe",
    names=named_parts,
)
"""The tree of a robot. Its variables begin with HDROBOT_, because all that begin with HD_ are settings of runs."""

DEFAULT_PROFILE = "bare"

INTRODUCTION = """# Parameters of the robot side

<!-- Made by `make docs` from deploy/config.py: change the text there. -->

A robot has one typed tree of parameters. Each source overrides the ones before it:

1. the defaults below,
2. a profile: `--profile bare` (the default), [`cmu`](cmu.md) or [`nav2`](nav2.md),
3. a TOML or JSON file: `--config robot.toml`,
4. environment variables: `HDROBOT_DECISION__PLANNER=tare` sets `decision.planner`,
5. the command line: `--set decision.planner=tare`, repeatable.

`hd-deploy config` takes the same options and prints the resolved tree as TOML, which `--config` accepts.
What nobody set and follows from other parameters, from TF or from the environment is in it as a comment.
An unknown parameter or a value out of range is an error that names the parameter, the source of the value and what
was expected. In a file, `"null"` unsets a parameter.
"""


def load_deploy_config(
    file: Path | None = None,
    overrides: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    profile: str | None = None,
) -> DeployConfig:
    """Resolve the configuration of a robot.

    Args:
        file: TOML or JSON file with (part of) the tree.
        overrides: ``section.field=value`` texts of the command line.
        environment: variables such as ``HDROBOT_DECISION__PLANNER=tare``; none when not given.
        profile: name of a shipped profile; `DEFAULT_PROFILE` when not given.

    Raises:
        ConfigError: for anything unknown, malformed or out of range; all problems are listed at once.
    """
    return DEPLOY.load(file, overrides, environment, profile or DEFAULT_PROFILE)


def documentation() -> str:
    """Write docs/deploy/parameters.md."""
    return INTRODUCTION + "\n" + to_markdown(DeployConfig)
