import itertools
import json

from common.page.hub import Hub
from learner.page.curves import MAX_POINTS, CurveChannels, Point


def shown(hub):
    view = hub.join()
    view.watch(["curve-*"])
    found = json.loads(hub.collect(view)[0])
    hub.leave(view)
    return found["values"]["curve-tags"], found["series"]["curve-points"]["items"]


def point(updates, **values):
    return Point(1e9 + updates, updates, values or {"loss/critic": 1.0 / (1 + updates)})


def test_a_run_of_any_length_has_a_bounded_curve_that_spans_all_of_it():
    hub, curves = Hub(), CurveChannels()
    for updates in range(0, 50_000, 7):
        curves.add(hub, point(updates))
        if updates == 21_000:
            curves.add(hub, point(updates, **{"evaluation/distance": 12.5}))
    tags, rows = shown(hub)
    assert MAX_POINTS / 2 < len(rows) <= 2 * MAX_POINTS
    times = [row[1] for row in rows]
    assert times == sorted(times)
    assert (times[0], times[-1] > 49_000) == (0, True)
    assert max(b - a for a, b in itertools.pairwise(times)) < 200, "evenly"
    evaluations = [row for row in rows if row[3:] not in ([], [None])]
    assert evaluations == [[1e9 + 21_000, 21_000, None, 12.5]], "they stay"
    assert tags == ["loss/critic", "evaluation/distance"]


def test_what_was_before_the_page_goes_on_without_a_seam():
    hub, curves = Hub(), CurveChannels()
    curves.load(hub, [point(updates) for updates in range(0, 30_000, 10)])
    curves.add(hub, point(30_001))
    curves.add(hub, point(30_100))
    times = [row[1] for row in shown(hub)[1]]
    assert len(times) <= MAX_POINTS + 2
    assert times[-2:] == [29_990, 30_100], "the point between was too near"


def test_a_resumed_learner_makes_its_last_updates_again():
    hub, curves = Hub(), CurveChannels()
    for updates in (0, 100, 200, 300, 150, 250):
        curves.add(hub, point(updates))
    assert [row[1] for row in shown(hub)[1]] == [0, 100, 150, 250]


def test_what_is_not_finite_is_left_out_and_not_refused():
    hub, curves = Hub(), CurveChannels()
    curves.add(hub, point(1, **{"loss/critic": float("nan"), "loss/policy": float("inf"), "value/q": 1.0}))
    assert shown(hub)[1][0][2:] == [None, None, 1.0]
