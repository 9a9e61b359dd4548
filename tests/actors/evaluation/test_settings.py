import pytest

from actors.evaluation.large.robot import LIDAR
from actors.evaluation.settings import EvaluationSettings

EARLIER = {"maps", "metres_per_pixel", "task", "mapping", "simulator", "seed", "policy"}


def test_evaluations_of_earlier_releases_can_be_continued():
    """Their journals are compared with these fingerprints, field by field."""
    plain = EvaluationSettings(maps=("generator:rooms",))
    assert set(plain.fingerprint("greedy")) == EARLIER
    large = EvaluationSettings(maps=("generator:building",), simulator=LIDAR, large=True)
    assert set(large.fingerprint("greedy")) == {*EARLIER, "targets"}


def test_a_robot_replans_on_its_way_at_a_large_scale_alone():
    with pytest.raises(ValueError, match=r"replan 'seen' is for evaluations at a large scale \(hd-eval large\)"):
        EvaluationSettings(maps=("generator:rooms",), replan="seen")
    assert EvaluationSettings(maps=("generator:rooms",), simulator=LIDAR, large=True, replan="seen").replan == "seen"
