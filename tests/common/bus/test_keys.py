import pytest

from common.bus.keys import Keys, host_of, last_part, process_of, run_of
from common.errors import BusError


def test_the_key_space():
    keys = Keys("office-2")
    assert keys.spec == "hd/office-2/spec"
    assert keys.experience("desk-0") == "hd/office-2/experience/desk-0"
    assert keys.weights_notice == "hd/office-2/weights/notice"
    assert keys.weights == "hd/office-2/weights/latest"
    assert keys.live("evaluator", "desk-1") == "hd/office-2/live/evaluator/desk-1"
    assert keys.stats("learner", "learner") == "hd/office-2/stats/learner/learner"
    assert keys.control("stop") == "hd/office-2/control/stop"


@pytest.mark.parametrize("name", ["", "a/b", "*", "Desk", "a b", "x" * 65, "$*", "ä", "a\n"])
def test_names_that_would_break_out_of_their_part_are_refused(name):
    with pytest.raises(BusError, match="lower-case"):
        Keys(name)
    with pytest.raises(BusError, match="lower-case"):
        Keys("run").experience(name)
    with pytest.raises(BusError, match="lower-case"):
        Keys("run").live("actor", name)


def test_roles_and_verbs_are_checked():
    with pytest.raises(BusError, match="a role must be one of learner"):
        Keys("run").stats("boss", "a")
    with pytest.raises(BusError, match="a command must be one of status"):
        Keys("run").control("explode")


def test_parts_of_keys():
    assert last_part("hd/run/experience/desk-0") == "desk-0"
    assert process_of("hd/run/live/actor/desk-0") == ("actor", "desk-0")


@pytest.mark.parametrize(
    "key", ["hd/run/live/boss/desk-0", "hd/run/live/actor/desk\x1b[2J", "hd/run/live/actor/Desk", "hd/run/live/actor/"]
)
def test_keys_of_strangers_name_no_process(key):
    with pytest.raises(BusError):
        process_of(key)


def test_the_run_of_a_stranger_is_none():
    with pytest.raises(BusError):
        run_of("hd/\x1b[2J/spec")


@pytest.mark.parametrize(
    ("actor", "certified", "host"),
    [
        ("desk-0", (), "desk"),
        ("desk-eval-12", (), "desk"),
        ("desk", (), "desk"),
        ("my-desk-3-0", (), "my-desk-3"),
        ("desk-arm-3", ("other", "desk"), "desk"),
        ("desk", ("desk",), "desk"),
        ("desktop-1", ("desk",), "desktop"),
    ],
)
def test_the_host_of_an_actor(actor, certified, host):
    assert host_of(actor, certified) == host
