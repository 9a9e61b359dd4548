import json

import numpy as np
import pytest

from common.page.hub import MAX_CHANNELS, MAX_ITEMS, MAX_VALUE, Hub, PageError


def text(frames):
    return json.loads(frames[0])


def test_a_browser_that_skips_gets_the_newest_and_costs_nothing():
    hub = Hub()
    quick, slow = hub.join(), hub.join()
    for view in (quick, slow):
        view.watch(["robot/*"])
    for number in range(1000):
        hub.put("robot/state", {"number": number})
        hub.append("robot/way", number)
        assert text(hub.collect(quick))["values"] == {"robot/state": {"number": number}}
    found = text(hub.collect(slow))
    assert found["values"] == {"robot/state": {"number": 999}}
    assert found["series"]["robot/way"] == {"start": 0, "items": list(range(1000))}
    assert hub.collect(slow) == hub.collect(quick) == []


def test_what_several_browsers_lack_is_made_once():
    hub = Hub()
    views = [hub.join() for _ in range(10)]
    for view in views:
        view.watch(["a", "grid"])
    hub.put("a", list(range(100)))
    hub.grid("grid", np.zeros((10, 10), np.int8), 1.0, (0.0, 0.0))
    frames = [hub.collect(view) for view in views]
    assert len({id(frame) for each in frames for frame in each}) == 2


def test_a_series_keeps_its_newest_items_and_forgets_when_it_is_cleared():
    hub = Hub()
    view = hub.join()
    view.watch(["s"])
    for number in range(MAX_ITEMS + 5):
        hub.append("s", number)
    found = text(hub.collect(view))["series"]["s"]
    assert (found["start"], len(found["items"]), found["items"][-1]) == (5, MAX_ITEMS, MAX_ITEMS + 4)
    following = found["start"] + len(found["items"])
    hub.append("s", "one more")
    assert text(hub.collect(view))["series"]["s"] == {"start": following, "items": ["one more"]}
    hub.clear("s")
    assert text(hub.collect(view))["series"]["s"] == {"start": following + 2, "items": []}


def test_only_what_is_watched_is_sent_and_browsers_hear_what_is_gone():
    hub = Hub()
    view = hub.join()
    hub.put("robot/a/state", 1)
    hub.put("robot/b/state", 2)
    assert hub.collect(view) == []
    view.watch(["robot/a/*"])
    assert hub.watched("robot/a/state")
    assert not hub.watched("robot/b/state")
    assert text(hub.collect(view)) == {"type": "update", "values": {"robot/a/state": 1}}
    hub.drop("robot/a/")
    assert text(hub.collect(view)) == {"type": "update", "gone": ["robot/a/state"]}
    hub.put("robot/a/state", 3)
    hub.drop("robot/a/")
    hub.put("robot/a/state", 3)
    assert text(hub.collect(view))["values"] == {"robot/a/state": 3}
    hub.leave(view)
    assert not hub.watched("robot/a/state")


@pytest.mark.parametrize(
    "value", [float("nan"), float("inf"), {1: object()}, "x" * (MAX_VALUE + 1)], ids=["nan", "inf", "object", "long"]
)
def test_what_no_browser_can_read_is_refused(value):
    hub = Hub()
    with pytest.raises(PageError, match="'a'"):
        hub.put("a", value)


def test_channels_are_bounded_and_of_one_kind():
    hub = Hub()
    for number in range(MAX_CHANNELS):
        hub.put(f"c{number}", 0)
    with pytest.raises(PageError, match="at most"):
        hub.put("one more", 0)
    with pytest.raises(PageError, match="another kind"):
        hub.append("c1", 0)
    with pytest.raises(PageError, match="names"):
        Hub().put("x" * 200, 0)
