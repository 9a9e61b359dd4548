"""Families of worlds: what each episode draws, and how the families share the steps."""

import numpy as np
import pytest

from actors.arena import Arena
from actors.collector import Collector
from actors.simulators.grid import GridSimulator
from common.config import FamilyConfig, SimulatorConfig
from common.config.load import load_config, resolve
from common.errors import ConfigError
from common.messages.experience import Chunk, EpisodeReport

SMALL = "generator:rooms?width=192&height=192"
NETWORK = {"width": 16, "heads": 2, "layers": 1, "features": "guided", "graph": "tokens", "toward": True}
SIMULATOR = {"name": "grid", "rays": 180}


def run_of(*families: dict, **sections: dict):
    maps = {"train": [SMALL], "validation": [SMALL], "validation_count": 4}
    return resolve({"families": list(families), "network": NETWORK, "simulator": SIMULATOR, "maps": maps, **sections})


def arena_of(*, evaluate: bool = False, **family) -> Arena:
    config = run_of({"name": "small", **family})
    simulator = GridSimulator(SimulatorConfig(**SIMULATOR), config.mapping.sensor_range)
    return Arena(config, config.task, config.mix[0], 0, simulator, evaluate=evaluate)


def test_each_episode_draws_its_mapping_within_the_bounds():
    arena = arena_of(sensor_range=(10.0, 30.0), viewpoint_spacing=(2.0, 5.0), robot_radius=(0.0, 0.5))
    rng = np.random.default_rng(0)
    drawn = [arena.draw(rng).environment.mapping for _ in range(20)]
    for name, low, high in (("sensor_range", 10, 30), ("viewpoint_spacing", 2, 5), ("robot_radius", 0, 0.5)):
        values = [getattr(mapping, name) for mapping in drawn]
        assert low <= min(values) < max(values) <= high
    assert all(mapping.beacon_range == pytest.approx(mapping.sensor_range) for mapping in drawn)


def test_the_sensor_reaches_as_far_as_the_mapping_of_the_episode_says():
    arena = arena_of(sensor_range=(3.0, 3.0), viewpoint_spacing=(2.0, 2.0))
    stage = arena.draw(np.random.default_rng(1))
    stage.environment.reset(stage.world, 0)
    scan = stage.environment._simulator.scan()
    assert scan.range_max == 3.0
    observation = stage.environment.mapper.observe()
    assert observation.reach == 1.5


def test_a_family_without_bounds_has_the_mapping_of_the_run():
    arena = arena_of()
    assert arena.draw(np.random.default_rng(0)).environment.mapping == load_config().mapping


def test_validation_is_the_same_in_every_round():
    arena = arena_of(evaluate=True, sensor_range=(10.0, 30.0))
    first, second = arena.fixed(3), arena.fixed(3)
    assert first.environment.mapping == second.environment.mapping != arena.fixed(4).environment.mapping
    assert (first.world.free == second.world.free).all()


def test_families_share_the_steps():
    config = run_of(
        {"name": "one", "share": 3.0, "max_steps": 8},
        {"name": "two", "share": 1.0, "max_steps": 8},
        cloning={"updates": 10, "expert_episodes": 1.0},
        reward={"kind": "potential"},
    )
    delivered: list[Chunk | EpisodeReport] = []
    collector = Collector(config, [0], delivered.append)
    while collector.steps < 160:
        collector.collect()
    collector.close()
    reports = [item for item in delivered if isinstance(item, EpisodeReport)]
    steps = {name: sum(r.steps for r in reports if r.family == name) for name in ("one", "two")}
    assert steps["one"] / steps["two"] == pytest.approx(3.0, rel=0.25)
    chunks = [item for item in delivered if isinstance(item, Chunk)]
    assert any(chunk.observations.route_count.any() for chunk in chunks)


def test_evaluation_tells_how_far_the_classical_planner_drives():
    config = run_of({"name": "one"}, {"name": "two", "tasks": ["exploration"]})
    delivered: list[Chunk | EpisodeReport] = []
    collector = Collector(config, [0], delivered.append, role="evaluate")
    assert [arena.family for arena, _ in collector.worlds] == ["one", "one", "two", "two"]
    reports = [collector.evaluate(0), collector.evaluate(0), collector.evaluate(2)]
    collector.close()
    assert reports[0].classical_distance == reports[1].classical_distance > 10.0
    assert reports[2].family == "two"


@pytest.mark.parametrize(
    ("families", "words"),
    [
        ([{"name": "a"}, {"name": "a"}], "unique names"),
        ([{"name": "A b"}], "lower-case"),
        ([{"name": "a", "sensor_range": [30.0, 10.0]}], "lower bound comes first"),
        ([{"name": "a", "viewpoint_spacing": [0.3, 1.0]}], "two belief cells"),
        ([{"name": "a", "tasks": ["navigation"]}], "none of them serves the task 'exploration'"),
    ],
)
def test_families_that_make_no_sense_are_refused(families, words):
    with pytest.raises(ConfigError, match=words):
        run_of(*families)


def test_sources_of_a_family_are_its_own_or_those_of_the_run():
    config = run_of({"name": "one"}, {"name": "two", "train": ["generator:office"]})
    assert config.sources(config.mix[0], "exploration", evaluate=False) == (SMALL,)
    assert config.sources(config.mix[1], "exploration", evaluate=False) == ("generator:office",)
    # Whoever names worlds to train in names those of validation, too: others are never mixed in.
    assert config.sources(config.mix[1], "exploration", evaluate=True) == ()
    assert config.training_sources == (SMALL, "generator:office")
    assert FamilyConfig(name="x").share == 1.0
