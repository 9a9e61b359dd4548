import re
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from learner.watch.metrics import Curves, Means, RateMeter
from tests.learner.experience import deliver, episode_report
from tests.learner.runs import PPO, episodes, make_trainer, small_config, train_some

DOCUMENT = Path(__file__).parents[3] / "docs" / "metrics.md"


def names(folder):
    accumulator = EventAccumulator(str(folder))
    accumulator.Reload()
    return accumulator


@pytest.mark.parametrize("changes", [{"cloning": {"anchor_weight": 0.1}}, PPO], ids=["sac", "ppo"])
def test_every_curve_is_explained_in_the_docs(tmp_path, changes):
    from learner.run.folder import RunFolder

    config = small_config(contrastive={"weight": 0.1}, **changes)
    with RunFolder.create(tmp_path, config) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(4, labelled="algorithm" in changes):
            trainer.ingest.store(delivery)
        trainer.publish()
        bodies = [episode_report("evaluate", 1, map_name=name) for name in "ab"] + [episode_report(driver="expert")]
        for delivery in deliver(bodies, actor="eval-0"):
            trainer.ingest.store(delivery)
        trainer.serve()
        train_some(trainer, 10)
        trainer.close()
        written = names(run.tensorboard).Tags()["scalars"]
    text = DOCUMENT.read_text("utf-8")
    grouped = ("episode_train/", "episode_expert/", "episode_evaluate/", "evaluation/")
    assert {name.split("/")[0] + "/" for name in written} >= set(grouped)
    for name in {re.sub(r"_\d+$", "_N", name) for name in written}:
        group, _, leaf = name.partition("/")
        found = f"`{leaf}`" in text and f"{group}/" in text if f"{group}/" in grouped else f"`{name}`" in text
        assert found, f"{name} is not in docs/metrics.md"


def test_a_resumed_curve_hides_what_is_trained_again(tmp_path):
    first = Curves(tmp_path)
    for update in (10, 20, 30):
        first.write(update, {"loss/critic": float(update)})
    first.close()
    second = Curves(tmp_path, update=15)
    for update in (20, 40):
        second.write(update, {"loss/critic": update + 0.5})
    second.close()
    scalars = names(tmp_path).Scalars("loss/critic")
    assert [(event.step, event.value) for event in scalars] == [(10, 10.0), (20, 20.5), (40, 40.5)]


def test_rates_count_the_late_seconds_alone():
    now = [0.0]
    meter = RateMeter(window=10.0, clock=lambda: now[0])
    assert meter.rate == 0.0
    for second in range(1, 6):
        now[0] = float(second)
        meter.add(4)
    assert meter.rate == 4.0
    now[0] = 12.0
    assert meter.rate == 4 * 4 / 10.0
    now[0] = 100.0
    assert meter.rate == 0.0


def test_means_begin_anew_after_each_reading_and_survive_a_checkpoint():
    means = Means()
    means.add({"a": 1.0, "b": 5.0})
    means.add({"a": 3.0})
    again = Means()
    again.restore(means.state())
    assert means.take() == again.take() == {"a": 2.0, "b": 5.0}
    assert means.take() == {}
