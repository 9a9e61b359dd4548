import json

from learner.run.episodes import EpisodeLog
from learner.run.evaluation import EvaluationRounds, Evaluators, Round, Score
from tests.learner.experience import episode_report
from tests.learner.runs import small_config


def evaluate(version, name, **changes):
    return episode_report("evaluate", version, map_name=name, **changes)


def test_a_round_is_complete_when_one_version_has_run_on_every_world():
    rounds = EvaluationRounds(worlds=2)
    assert rounds.add("eval-0", 1, evaluate(5, "a", distance=100.0)) is None
    assert rounds.add("eval-0", 1, evaluate(5, "a", distance=100.0)) is None  # the same world again
    assert rounds.versions == {5}
    done = rounds.add("eval-0", 1, evaluate(5, "b", distance=300.0, success=False))
    assert done is not None
    assert (done.version, done.means.distance, done.means.success) == (5, 200.0, 0.5)
    assert rounds.versions == set()


def test_unfinished_rounds_are_given_up_and_evaluators_counted_apart():
    rounds = EvaluationRounds(worlds=2)
    rounds.add("eval-0", 1, evaluate(5, "a"))
    rounds.add("eval-1", 1, evaluate(5, "b"))
    assert rounds.add("eval-0", 1, evaluate(6, "b")) is None
    assert rounds.add("eval-0", 2, evaluate(6, "a")) is None
    assert rounds.add("eval-1", 1, evaluate(5, "a")) is not None


def test_a_round_has_no_more_worlds_than_the_evaluator_has(caplog):
    rounds = EvaluationRounds(worlds=50)
    drive = [evaluate(version, name, distance=10.0 * version) for version in (5, 6, 7) for name in "abc"]
    done = [rounds.add("eval-0", 1, report) for report in drive]
    # Only when a second version has run in the same worlds it is plain that there are no others.
    assert [each and each.version for each in done] == [None] * 5 + [6] + [None] * 2 + [7]
    assert done[5].means.count == 3
    assert "has 3 validation worlds, and maps.validation_count is 50" in caplog.text
    fresh = EvaluationRounds(worlds=50)
    for incarnation in (1, 2):  # it crashes at the fourth world, again and again
        assert not any(fresh.add("eval-0", incarnation, report) for report in drive[:3])


def asked(hosts=(), own=(), certified=(), **bus):
    config = small_config(learner={"evaluators": list(hosts)}, bus=bus)
    return Evaluators.of(config, certified, own)


TLS = {"tls_ca": "ca.pem", "tls_certificate": "learner.pem", "tls_key": "learner.key", "tls_access": "access.json"}


def test_whose_evaluations_count():
    assert asked().count("anybody-0")
    assert asked(own=["local"]).count("local-eval-0")
    assert not asked(own=["local"]).count("desk-0")
    assert asked(["judge"], own=["local"]).count("judge-3")
    # With certificates names are true, and so only those count that somebody has named.
    assert not asked(**TLS, certified=["desk"]).count("desk-0")
    assert asked(["desk"], **TLS, certified=["desk"]).count("desk-arm-eval-0")
    assert not asked(["desk"], **TLS, certified=["desk", "desktop"]).count("desktop-0")


def test_fifty_invented_reports_choose_nothing(caplog):
    rounds = EvaluationRounds(2, asked(["judge"]), lambda: 7)
    for number in range(50):
        assert rounds.add("desk-0", 1, evaluate(5, f"invented-{number}", distance=0.0)) is None
    assert rounds.ignored == 50
    assert caplog.text.count("an evaluation does not count") == 1
    assert "--set learner.evaluators=desk" in caplog.text


def test_versions_and_worlds_that_are_not_the_runs_count_nowhere(caplog):
    rounds = EvaluationRounds(2, asked(["judge"]), lambda: 7)
    for name in "ab":
        assert rounds.add("judge-0", 1, evaluate(8, name)) is None
        assert rounds.add("judge-0", 1, evaluate(-1, name)) is None
    assert rounds.ignored == 4
    rounds.add("judge-0", 1, evaluate(7, "a"))
    assert rounds.add("judge-0", 1, evaluate(7, "b")) is not None
    for name in "cd":
        assert rounds.add("judge-1", 1, evaluate(7, name)) is None
    assert rounds.ignored == 6
    assert "never published" in caplog.text
    assert "other worlds" in caplog.text


def test_names_without_end_open_no_rounds_without_end():
    rounds = EvaluationRounds(2)
    for number in range(2000):
        rounds.add(f"eval-{number}", 1, evaluate(1, "a"))
    assert len(rounds.state()) <= 256


def test_success_counts_before_distance():
    assert Score.of({"success": 0.9, "distance": 400.0}) > Score.of({"success": 0.8, "distance": 100.0})
    assert Score.of({"success": 0.9, "distance": 100.0}) > Score.of({"success": 0.9, "distance": 101.0})


def test_of_a_mix_the_worst_family_counts_and_failures_count_twice():
    good = [evaluate(1, "a", family="one", distance=90.0, classical_distance=100.0)]
    rounds = [
        Round.of(1, [*good, evaluate(1, "a", family="two", distance=300.0, classical_distance=200.0)]),
        Round.of(1, [*good, evaluate(1, "a", family="two", distance=120.0, classical_distance=200.0, success=False)]),
        Round.of(1, [*good, evaluate(1, "a", family="two", distance=190.0, classical_distance=200.0)]),
    ]
    assert [done.ratios["two/exploration"] for done in rounds] == [1.5, 1.2, 0.95]
    assert rounds[0].figures["worst_ratio"] == 1.5
    scores = [Score.of(done.figures) for done in rounds]
    assert scores[0] < scores[1] < scores[2]


def test_worlds_of_one_name_in_two_families_are_two():
    rounds = EvaluationRounds(worlds=2)
    assert rounds.add("eval-0", 1, evaluate(5, "a", family="one")) is None
    restored = EvaluationRounds(worlds=2)
    restored.restore(json.loads(json.dumps(rounds.state())))
    assert restored.add("eval-0", 1, evaluate(5, "a", family="two")) is not None


def test_episodes_are_one_line_each_and_means_are_kept_by_group(tmp_path):
    log = EpisodeLog(tmp_path / "episodes.jsonl")
    assert log.means("train") is None
    log.append(episode_report(distance=100.0), time=1.0, updates=0, actor="a-0")
    length = log.length
    log.append(episode_report(distance=300.0), time=1.0, updates=0, actor="a-0")
    log.append(episode_report(driver="expert", distance=50.0), time=1.0, updates=0, actor="a-0")
    log.close()
    lines = [json.loads(line) for line in (tmp_path / "episodes.jsonl").read_text().splitlines()]
    assert [line["distance"] for line in lines] == [100.0, 300.0, 50.0]
    assert lines[0]["actor"] == "a-0"
    again = EpisodeLog(tmp_path / "episodes.jsonl")
    assert again.means("train").distance == 200.0
    assert again.means("expert").count == 1
    again.close()
    cut = EpisodeLog(tmp_path / "episodes.jsonl", length)
    assert cut.means("train").distance == 100.0
    assert cut.length == length == (tmp_path / "episodes.jsonl").stat().st_size
    cut.close()
