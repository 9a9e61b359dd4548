from deploy.config import SafetyConfig
from deploy.safety.progress import ProgressMonitor


def make(seconds: float = 30.0) -> ProgressMonitor:
    return ProgressMonitor(SafetyConfig(progress_time=seconds))


def test_standstill_is_noticed_after_the_time():
    monitor = make()
    assert not monitor.update(0.0, 10.0)
    assert not monitor.update(29.9, 10.0)
    assert monitor.update(30.0, 10.2)  # a little noise of the map is no progress


def test_new_area_is_progress():
    monitor = make()
    assert not any(monitor.update(float(t), 10.0 + 0.1 * t) for t in range(300))


def test_coming_and_going_area_is_none():
    monitor = make()
    monitor.update(0.0, 100.0)
    assert any(monitor.update(float(t), 100.0 - (t % 2)) for t in range(1, 40))


def test_a_long_way_through_known_area_is_progress():
    monitor = make()
    assert not any(monitor.update(float(t), 10.0, (50.0, 0.0), 50.0 - 0.2 * t) for t in range(200))


def test_swinging_between_two_goals_is_none():
    monitor = make()
    stalled = False
    for t in range(120):
        swing = abs(t % 20 - 10)
        goal, distance = ((0.0, 0.0), 5.0 + swing) if t // 20 % 2 else ((9.0, 0.0), 15.0 - swing)
        stalled = stalled or monitor.update(float(t), 10.0, goal, distance)
    assert stalled


def test_reset_begins_the_time_anew():
    monitor = make()
    monitor.update(0.0, 10.0)
    monitor.reset(25.0)
    assert not monitor.update(50.0, 10.0)
    assert monitor.stalled_for(50.0) == 25.0
    assert monitor.update(55.0, 10.0)
