import csv
import io
import math

import numpy as np
import pytest

from actors.evaluation.results import ResultsError
from actors.evaluation.statistics import compare, distance_ratio, group_means, summarise
from actors.evaluation.table import make_rows, notes, render
from tests.actors.evaluation.small import results


def test_figures_by_hand():
    summary = summarise(results(distances=(10.0, 20.0, 60.0), success=[True, True, False]))
    assert summary.mean == 30.0
    assert summary.std == pytest.approx(math.sqrt((400 + 100 + 900) / 2))
    assert summary.success == pytest.approx(2 / 3)
    assert (summary.steps, summary.median_ms, summary.p95_ms) == (1.0, 2.0, 3.0)
    assert math.isnan(summarise(results(distances=(10.0,))).std)


def test_a_comparison_agrees_with_scipy_on_the_pairs():
    # A second, which every process that collects tests would pay.
    from scipy import stats

    random = np.random.default_rng(4)
    b = random.uniform(50, 100, 40)
    a = b * 0.9 + random.normal(0, 3, 40)
    found = compare(results("a", a.tolist()), results("b", b.tolist()))
    assert found.ratio == pytest.approx(a.sum() / b.sum())
    assert found.difference == pytest.approx((a - b).mean())
    assert found.t_p == pytest.approx(stats.ttest_rel(a, b).pvalue)
    assert found.wilcoxon_p == pytest.approx(stats.wilcoxon(a, b).pvalue)
    assert found.low < found.ratio < found.high
    assert found.high < 1.0
    assert (found.maps, found.failures) == (40, 0)
    again = compare(results("a", a.tolist()), results("b", b.tolist()))
    assert again == found


def test_maps_are_paired_by_name_and_order_does_not_matter():
    a = results("a", (10.0, 20.0, 30.0))
    b = results("b", (20.0, 40.0, 60.0))
    turned = b.model_copy(update={"episodes": b.episodes[::-1][:2]})
    assert distance_ratio(a, turned) == pytest.approx(0.5)
    assert compare(a, turned).maps == 2
    renamed = b.model_copy(update={"episodes": [e.model_copy(update={"map": "x" + e.map}) for e in b.episodes]})
    with pytest.raises(ResultsError, match="no map in common"):
        compare(a, renamed)


def test_equal_planners_are_no_evidence():
    found = compare(results("a"), results("b"))
    assert (found.ratio, found.t_p, found.wilcoxon_p) == (1.0, 1.0, 1.0)
    single = compare(results("a", (5.0,)), results("b", (10.0,)))
    assert single.ratio == 0.5
    assert math.isnan(single.t_p)


def test_means_by_folder():
    one = results(distances=(10.0, 20.0, 40.0))
    names = ("easy/1.png", "easy/2.png", "complex/1.png")
    episodes = [e.model_copy(update={"map": name}) for e, name in zip(one.episodes, names, strict=True)]
    assert group_means(one.model_copy(update={"episodes": episodes})) == {"easy": 15.0, "complex": 40.0}
    assert group_means(one) == {}


def test_the_table_in_all_formats():
    found = [results("greedy_1", (10.0, 20.0, 31.0)), results("omniscient", (8.0, 15.0, 20.0))]
    titles, rows = make_rows(found, "omniscient")
    remarks = notes(found, "omniscient")
    values = dict(zip(titles, rows[0], strict=True))
    assert values["planner"] == "greedy_1"
    assert values["mean [m]"] == "20.3"
    assert values["success"] == "100.0 %"
    assert values["/ omniscient"] == "1.419"
    assert "greedy_1" in render(titles, rows, "text", remarks)
    markdown = render(titles, rows, "markdown", remarks).splitlines()
    assert len({line.count("|") for line in markdown[:4]}) == 1
    latex = render(titles, rows, "latex", remarks)
    assert "greedy\\_1 & 3" in latex
    assert "100.0 \\%" in latex
    table = list(csv.reader(io.StringIO(render(titles, rows, "csv"))))
    assert table == [titles, *rows]
    titles, rows = make_rows(found, None, "px")
    assert rows[0][titles.index("mean [px]")] == "81.3"


def test_names_in_a_table_stay_what_they_are():
    """A planner of somebody else's results may have any name."""
    titles, rows = make_rows([results("[bold]a|b~c\x1b[31m\n")], None)
    shown = "[bold]a|b~c\\x1b[31m\\x0a"
    assert shown in render(titles, rows, "text")
    assert shown.replace("|", "\\|") in render(titles, rows, "markdown")
    assert "a|b\\textasciitilde{}c" in render(titles, rows, "latex")


def test_the_notes_tell_of_other_sensors():
    found = [results("a"), results("b").model_copy(update={"sensor_range_m": 7.5})]
    assert any(line.startswith("Sensor ranges differ (7.5, ") for line in notes(found, None))
    assert not any("Sensor" in line for line in notes(found[:1], None))


def test_the_notes_tell_of_failures_and_of_other_maps():
    found = [results("a", success=[True, False, False]), results("b", (1.0, 2.0))]
    text = " ".join(notes(found, None))
    assert "a 2" in text
    assert "same maps" in text
