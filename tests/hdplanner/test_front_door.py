"""The package that strangers import."""

import ast
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

import actors.cli
import actors.evaluation.cli
import deploy.cli
import hdplanner
import hdplanner.cli
import hdplanner.evaluation
import learner.cli
from common.errors import ConfigError, MapError
from common.planners.exploration.greedy import GreedyPlanner
from hdplanner import evaluate, load_policy, make_planner
from tests.plugins import install

ROOT = Path(__file__).parents[2]
SMALL = ["generator:rooms?width=320&height=240"]
COMMANDS = {
    "hd-learner": learner.cli.app,
    "hd-actor": actors.cli.app,
    "hd-eval": actors.evaluation.cli.app,
    "hd-deploy": deploy.cli.app,
    "hdplanner": hdplanner.cli.app,
}


def test_every_name_can_be_had_and_is_known_to_type_checkers():
    for name in hdplanner.__all__:
        assert getattr(hdplanner, name) is not None
        assert name in dir(hdplanner)
    tree = ast.parse((ROOT / "hdplanner" / "__init__.py").read_text("utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    declared = {alias.name: node.module for node in block.body for alias in node.names}
    assert declared == hdplanner._HOMES
    with pytest.raises(AttributeError, match="no attribute 'Maper': it has"):
        hdplanner.Maper  # noqa: B018


def test_a_robot_needs_neither_simulator_nor_torch():
    program = (
        "import sys; from hdplanner import Mapper, MappingConfig, Plan, Planner, Pose, Scan, make_planner; "
        "make_planner('tour', MappingConfig()); "
        "print([name for name in ('actors', 'learner', 'deploy', 'torch', 'pybullet', 'PIL') if name in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True)
    assert told.stdout.strip() == "[]"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_tells_the_version(command):
    told = CliRunner().invoke(COMMANDS[command], ["--version"])
    assert told.exit_code == 0, told.output
    assert told.output.startswith("hdplanner")


def test_all_parts_are_listed_those_of_packages_and_broken_ones_too(tmp_path, monkeypatch):
    install(
        tmp_path,
        "stranger",
        "[hdplanner.simulators]\nbroken = stranger_simulator:Simulator\n"
        "[hdplanner.planners]\nmine = stranger_planner:Mine\n",
        stranger_simulator="1 / 0",
        stranger_planner="class Mine:\n    'Goes home.'\n",
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    told = CliRunner().invoke(hdplanner.cli.app, ["parts"])
    assert told.exit_code == 0, told.output
    lines = [" ".join(line.split()) for line in told.output.splitlines()]
    assert "mine Goes home." in lines
    assert any(line.startswith("broken unusable: cannot load simulator 'broken'") for line in lines)
    assert "tour covering tour over all frontiers" in lines
    assert any(line.startswith("office ") for line in lines)


def test_planners_are_evaluated_by_name_or_by_class():
    by_name = evaluate("greedy", SMALL, count=2)
    by_class = evaluate(GreedyPlanner, SMALL, count=2)
    assert [result.success for result in by_name] == [True, True]
    assert [(each.map, each.distance_m, each.steps) for each in by_name] == [
        (each.map, each.distance_m, each.steps) for each in by_class
    ]
    assert len({result.map for result in by_name}) == 2
    assert evaluate("astar", SMALL, count=1, task="navigation")[0].success


class SlowToBegin(GreedyPlanner):
    """Compiles, so to say, for longer than a decision may take."""

    begun = False

    def plan(self, mapper, pose):
        if not self.begun:
            self.begun = True
            until = time.process_time() + 2.0
            while time.process_time() < until:
                pass
        return super().plan(mapper, pose)


def test_compiling_counts_for_no_decision(monkeypatch):
    monkeypatch.setattr(hdplanner.evaluation, "resolve", partial(hdplanner.evaluation.resolve, time_limit=1.0))
    (result,) = evaluate(SlowToBegin, SMALL, count=1)
    assert result.success, result.reason


def test_an_evaluation_follows_its_settings():
    (result,) = evaluate("greedy", SMALL, count=1, settings=["task.max_steps=2"])
    assert result.steps == 2
    assert not result.success
    (omniscient,) = evaluate("omniscient", SMALL, count=1)
    assert omniscient.success
    for mistake in ({"planner": "gredy"}, {"planner": "astar"}, {"planner": "greedy", "task": "explore"}):
        with pytest.raises(ConfigError):
            evaluate(maps=SMALL, count=1, **mistake)
    with pytest.raises(MapError):
        evaluate("greedy", ["nowhere/"])


def test_a_loaded_policy_makes_a_planner():
    policy, card = load_policy(task="navigation")
    assert card.task == "navigation"
    planner = make_planner("hdplanner", card.mapping, policy=(policy, card))
    assert planner.tasks == {"navigation"}
