import pytest

pytest.importorskip("PIL", reason="Pillow is not installed")

from deploy.robot.options import RobotOptions
from deploy.robot.trial import Trial
from tests.plans import two_rooms, write_image


def test_a_larger_world_is_given_more_time(tmp_path):
    small, large = write_image(two_rooms(), tmp_path / "plan.png"), "generator:office?width=512&height=512"
    seconds = [
        Trial(
            "exploration", options=RobotOptions(map=world), planner="nearest", profile="bare", folder=tmp_path
        ).ample_seconds
        for world in (small, large)
    ]
    assert seconds[0] == 900.0
    assert seconds[1] > 1800.0
