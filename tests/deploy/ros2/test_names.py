import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.ros2.errors import RosError
from deploy.ros2.names import namespace, topic_name

names = st.text("abzAZ_09", max_size=5).map(lambda text: "n" + text)


def test_namespace_in_full():
    assert namespace("") == namespace("/") == "/"
    assert namespace("robot1") == namespace("/robot1") == namespace("/robot1/") == "/robot1"
    assert namespace("fleet/robot1") == "/fleet/robot1"


def test_absolute_names_ignore_the_namespace():
    assert topic_name("/scan", "/robot1") == "/scan"
    assert topic_name("scan", "/robot1") == "/robot1/scan"
    assert topic_name("scan") == "/scan"


def test_remapping_knows_relative_and_absolute_names():
    assert topic_name("/scan", remap={"/scan": "/lidar/scan"}) == "/lidar/scan"
    assert topic_name("scan", "/robot1", {"scan": "front/scan"}) == "/robot1/front/scan"
    assert topic_name("scan", "/robot1", {"/scan": "/other"}) == "/robot1/scan"


@pytest.mark.parametrize("bad", ["", "/", "//scan", "/scan//raw", "/2d", "/scan raw", "/scän", "/*", "/a$b", "~/scan"])
def test_malformed_names_are_refused(bad):
    with pytest.raises(RosError, match="correct it"):
        topic_name(bad)


@given(st.lists(names, min_size=1, max_size=4), st.lists(names, max_size=2))
def test_names_resolve_once(parts, space):
    within = namespace("/".join(space))
    full = topic_name("/".join(parts), within)
    assert full.startswith("/")
    assert topic_name(full, within) == full
