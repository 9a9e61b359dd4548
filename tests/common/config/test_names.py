"""Which names of a configuration are code, and who may write them."""

import ast
from pathlib import Path

import pytest

from common.config.load import load_config
from common.config.names import config_from_message, module_names
from common.errors import ConfigError, MessageError

ROOT = Path(__file__).parents[3]
OWN = [
    "simulator.name=theirs:Simulator",
    "task.name=theirs:TASK",
    "maps.train=generator:theirs:Maze?width=320,generator:rooms",
]


def test_a_local_configuration_may_name_modules_and_must_name_what_exists():
    assert module_names(load_config(overrides=OWN)) == ["theirs:Simulator", "theirs:TASK", "theirs:Maze"]
    with pytest.raises(ConfigError) as error:
        load_config(overrides=["simulator.name=gird", "task.name=explore", "maps.validation=generator:ofice"])
    text = str(error.value)
    assert "simulator.name: there is no simulator 'gird' (did you mean 'grid'?)" in text
    assert "(from command line --set simulator.name)" in text
    assert "task.name: there is no task 'explore'" in text
    assert "maps.validation: there is no generator 'ofice'" in text


@pytest.mark.parametrize(
    "settings",
    [
        *([each] for each in OWN),
        ["maps.validation=generator:theirs:Maze"],
        ["maps.train_navigation=generator:theirs:Maze"],
        ["maps.validation_navigation=generator:theirs:Maze"],
        ['families=[{"name": "a"}, {"name": "b", "tasks": ["theirs:TASK"]}]'],
        ['families=[{"name": "a", "train": ["generator:theirs:Maze"]}]'],
        ['families=[{"name": "a", "validation": ["generator:theirs:Maze"]}]'],
    ],
    ids=lambda settings: settings[0],
)
def test_a_message_may_name_no_module_that_the_user_did_not(settings):
    config = load_config(overrides=settings)
    text = config.model_dump_json()
    with pytest.raises(ConfigError, match=r"the learner of run 'default' names the \w+ 'theirs:.*: allow it"):
        config_from_message(text, {"mine:Thing"}, "allow it")
    assert config_from_message(text, set(module_names(config)), "allow it") == config


def test_what_is_no_configuration_is_refused():
    for text in ("", "[]", '{"nonsense": 1}'):
        with pytest.raises(MessageError, match="is not a configuration of this version"):
            config_from_message(text, (), "allow it")
    with pytest.raises(MessageError, match="learner.hurry: extra inputs"):
        config_from_message('{"learner": {"hurry": 1}}', (), "allow it")


def test_there_is_no_other_door_for_configurations_of_messages():
    """Who reads a run's specification in another way would let the bus name modules."""
    for package in ("common", "actors", "learner", "deploy", "hdplanner"):
        for path in (ROOT / package).rglob("*.py"):
            text = path.read_text("utf-8")
            if not any(word in text for word in ("RunConfig", "fetch_spec", "list_runs")):
                continue
            tree = ast.parse(text)
            names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
            names |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
            reads_spec = "fetch_spec" in names or "list_runs" in names
            where = path.relative_to(ROOT).as_posix()
            assert (
                "RunConfig" not in names or "model_validate_json" not in names or where == "common/config/names.py"
            ), f"{where} parses a run's configuration by itself: use config_from_message"
            assert not (reads_spec and "resolve" in names), (
                f"{where}: use config_from_message for a run's specification"
            )
