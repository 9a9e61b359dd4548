import json

import pytest
from typer.testing import CliRunner

from actors.evaluation.cli import app
from actors.evaluation.results import DecisionTime, EpisodeResult, Results, write_results
from common.config import MappingConfig, NetworkConfig
from common.network.parameters import initial_parameters
from common.policies.policy_file import PolicyCard, read_policy, write_policy

NETWORK = NetworkConfig(width=16, heads=2, layers=1)


@pytest.fixture
def policy(tmp_path):
    path = tmp_path / "exploration.safetensors"
    card = PolicyCard("test", "exploration", NETWORK, MappingConfig(), 1, 0, 0, False, "abc", "now")
    write_policy(path, initial_parameters(NETWORK, 0), card)
    return path


def results_of(planner, distances, task="exploration"):
    episodes = [
        EpisodeResult(
            map=f"{i}.png",
            waypoints=[(0.0, 0.0)],
            distance_m=distance,
            steps=3,
            success=True,
            explored_rate=1.0,
            decision_ms=DecisionTime(median=2.0, p95=3.0),
        )
        for i, distance in enumerate(distances)
    ]
    return Results(
        task=task, metres_per_pixel=0.25, sensor_range_m=20.0, planner=planner, commit="abc", seed=0, episodes=episodes
    )


def test_figures_go_into_the_card_and_the_weights_stay(policy, tmp_path):
    weights = policy.read_bytes()
    folder = tmp_path / "results"
    folder.mkdir()
    write_results(folder / "hdplanner.json", results_of("hdplanner", [90.0, 90.0]))
    write_results(folder / "greedy.json", results_of("greedy", [100.0, 100.0]))
    done = CliRunner().invoke(app, ["card", str(policy), str(folder)])
    assert done.exit_code == 0, done.output
    bench = json.loads(policy.with_suffix(".json").read_text())["bench"]
    assert bench["hdplanner"] == {"maps": 2.0, "distance_m": 90.0, "success": 1.0, "decision_ms": 2.0}
    assert bench["greedy"]["ratio"] == 0.9
    assert policy.read_bytes() == weights
    assert read_policy(policy)[1].bench == bench


def test_results_of_another_task_are_refused(policy, tmp_path):
    write_results(tmp_path / "hdplanner.json", results_of("hdplanner", [90.0], "navigation"))
    done = CliRunner().invoke(app, ["card", str(policy), str(tmp_path / "hdplanner.json")])
    assert done.exit_code == 1
    assert "for exploration, the results are of navigation" in " ".join(done.stderr.split())
