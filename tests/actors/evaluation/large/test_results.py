"""Results of one protocol given to the commands of another."""

from pathlib import Path

import pytest

from actors.evaluation.large.results import collect_large_results
from actors.evaluation.results import ResultsError, collect_results

RELEASE = Path(__file__).parents[4] / "release" / "paper"


def test_results_of_another_protocol_name_the_commands_that_show_them():
    with pytest.raises(ResultsError, match=r"expected results of 'hd-eval run', got .*: take 'hd-eval large-table"):
        collect_results([RELEASE / "large-exploration"])
    with pytest.raises(ResultsError, match=r"expected results of 'hd-eval large', got .*: take 'hd-eval table"):
        collect_large_results([RELEASE / "navigation"])
    with pytest.raises(ResultsError, match=r"tare\.json is not a results file of 'hd-eval run'"):
        collect_results([RELEASE / "garden" / "tare.json"])
