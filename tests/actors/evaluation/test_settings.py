from actors.evaluation.large.robot import LIDAR
from actors.evaluation.settings import EvaluationSettings

EARLIER = {"maps", "metres_per_pixel", "task", "mapping", "simulator", "seed", "policy"}


def test_evaluations_of_earlier_releases_can_be_continued():
    """Their journals are compared with these fingerprints, field by field."""
    plain = EvaluationSettings(maps=("generator:rooms",))
    assert set(plain.fingerprint("greedy")) == EARLIER
    large = EvaluationSettings(maps=("generator:building",), simulator=LIDAR, large=True)
    assert set(large.fingerprint("greedy")) == {*EARLIER, "targets"}
