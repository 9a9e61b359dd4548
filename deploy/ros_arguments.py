"""The arguments that ROS 2 gives its nodes (`--ros-args`), as options of `hd-deploy`.

`ros2 run` and launch files name, remap and set parameters by these, so that the bridge and the relay are nodes as any
others: `-r __ns:=/robot1 -r /scan:=/front/scan -p decision.planner:=tare --params-file robot.yaml`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from common.errors import ConfigError

BEGIN: Final = "--ros-args"
END: Final = "--"
# Of nodes with parameters that are not ours: ROS 2 hands them to every node.
_FOREIGN: Final = frozenset({"use_sim_time"})
_SWITCHES: Final = ("--enable-", "--disable-")


def translate(arguments: Sequence[str]) -> list[str]:
    """Return a command line in which what stands between `--ros-args` and `--` is options of `hd-deploy`.

    Raises:
        ConfigError: an argument is none that ROS 2 has, or a file of parameters cannot be read.
    """
    plain: list[str] = []
    waiting = list(arguments)
    while waiting:
        word = waiting.pop(0)
        if word != BEGIN:
            plain.append(word)
            continue
        ours = waiting[: waiting.index(END)] if END in waiting else waiting
        waiting = waiting[len(ours) + 1 :]
        plain += _options(ours)
    return plain


def _options(words: list[str]) -> list[str]:
    settings: list[str] = []
    remap: dict[str, str] = {}
    others: list[str] = []
    left = list(words)
    while left:
        word = left.pop(0)
        if word.startswith(_SWITCHES):
            # Where ROS 2 logs to; we log to standard error.
            continue
        if word not in {"-r", "--remap", "-p", "--param", "--params-file", "--log-level"} or not left:
            raise ConfigError(
                f"{word!r} is no argument of ROS 2 that is known here: -r, -p, --params-file, --log-level"
            )
        value = left.pop(0)
        if word in {"-r", "--remap"}:
            name, new = _rule(word, value)
            special = {"__node": "ros.node", "__name": "ros.node", "__ns": "ros.namespace"}.get(name)
            if special is None:
                remap[name] = new
            else:
                settings.append(f"{special}={new}")
        elif word in {"-p", "--param"}:
            name, new = _rule(word, value)
            if name not in _FOREIGN:
                settings.append(f"{name}={new}")
        elif word == "--params-file":
            settings += parameters_of(Path(value))
        else:
            # `name:=level` sets one logger of many; the process has one level.
            others += ["--log-level", value.rpartition(":=")[2].lower()]
    if remap:
        settings.append(f"topics.remap={json.dumps(remap)}")
    return [*others, *(part for setting in settings for part in ("--set", setting))]


def parameters_of(file: Path) -> list[str]:
    """Return the settings in a file of ROS 2 parameters, of whichever nodes it holds.

    Raises:
        ConfigError: it cannot be read, or is no file of parameters.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        nodes = YAML(typ="safe").load(file.read_text("utf-8-sig"))
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        raise ConfigError(f"cannot read the parameters in {file}: {error}") from None
    settings: list[str] = []
    for node, content in nodes.items() if isinstance(nodes, Mapping) else [("", None)]:
        parameters = content.get("ros__parameters") if isinstance(content, Mapping) else None
        if not isinstance(parameters, Mapping):
            raise ConfigError(f"{file}: expected NODE: ros__parameters: NAME: VALUE, as ROS 2 has it, got {node!r}")
        settings += [f"{name}={_text(value)}" for name, value in _flat(parameters) if name not in _FOREIGN]
    return settings


def _flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        # A remapping is one setting, and a table.
        if isinstance(value, Mapping) and f"{prefix}{name}" != "topics.remap":
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _rule(option: str, text: str) -> tuple[str, str]:
    name, sign, value = text.partition(":=")
    if not sign or not name:
        raise ConfigError(f"{option} takes NAME:=VALUE, got {text!r}")
    return name, value
