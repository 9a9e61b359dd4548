"""Orders and the commands that change them."""

import pytest

from deploy.bridge.command_text import CommandError, parse
from deploy.bridge.mission import Mission, Phase


def test_a_task_runs_from_start_to_end():
    mission = Mission("exploration")
    assert mission.orders.phase is Phase.IDLE
    mission.start()
    mission.begun((1.0, 2.0))
    mission.begun((5.0, 5.0))
    assert mission.orders.moving
    assert mission.orders.home == (1.0, 2.0)
    episode = mission.orders.episode
    mission.end(Phase.FINISHED, "no frontier is left", episode)
    assert (mission.orders.phase, mission.orders.reason) == (Phase.FINISHED, "no frontier is left")
    mission.start()
    assert mission.orders.episode == episode + 1


def test_what_a_robot_waits_for_is_told_until_it_has_orders():
    mission = Mission("exploration", waits="starts by itself with a map and a pose")
    assert mission.orders.reason == "starts by itself with a map and a pose"
    mission.wait_for_start()
    assert mission.orders.reason == "waits for the command to start"
    mission.start()
    mission.wait_for_start()
    assert (mission.orders.phase, mission.orders.reason) == (Phase.RUNNING, "started by command")


def test_home_is_where_the_robot_is_when_it_is_started():
    places = iter([None, (1.0, 2.0), (5.0, 5.0)])
    mission = Mission("exploration", here=lambda: next(places))
    mission.start()
    with pytest.raises(CommandError, match="with its pose known"):
        mission.return_home()
    mission.abort()
    mission.start()
    mission.return_home()
    mission.begun((3.0, 3.0))
    mission.abort()
    mission.start()
    assert mission.orders.home == (1.0, 2.0)


def test_a_command_is_quicker_than_the_end_of_the_episode_before_it():
    mission = Mission("exploration")
    mission.start()
    old = mission.orders.episode
    mission.reset()
    mission.end(Phase.FINISHED, "done", old)
    assert mission.orders.phase is Phase.RUNNING
    mission.abort()
    mission.end(Phase.FINISHED, "done", mission.orders.episode)
    assert mission.orders.phase is Phase.ABORTED


@pytest.mark.parametrize("resume", ["resume", "start"])
def test_a_pause_keeps_the_episode(resume):
    mission = Mission("exploration")
    mission.start()
    episode = mission.orders.episode
    mission.pause()
    mission.pause()
    assert not mission.orders.moving
    getattr(mission, resume)()
    assert (mission.orders.phase, mission.orders.episode) == (Phase.RUNNING, episode)


@pytest.mark.parametrize("resume", ["resume", "start"])
def test_the_way_home_can_be_paused_too(resume):
    mission = Mission("exploration")
    mission.start()
    mission.begun((0.0, 0.0))
    mission.return_home()
    episode = mission.orders.episode
    mission.pause()
    getattr(mission, resume)()
    assert (mission.orders.phase, mission.orders.episode) == (Phase.RETURNING, episode)


@pytest.mark.parametrize(("task", "verb"), [("exploration", "return_home"), ("navigation", "start")])
def test_a_way_to_a_known_place_ends_where_the_odometry_began_anew(task, verb):
    mission = Mission(task, (4.0, 2.0))
    mission.start()
    mission.begun((0.0, 0.0))
    getattr(mission, verb)()
    mission.forget_home()
    assert (mission.orders.phase, mission.orders.home) == (Phase.ABORTED, None)
    assert "send a new goal, or `start`" in mission.orders.reason
    mission.start()
    mission.begun((1.0, 1.0))
    assert (mission.orders.phase, mission.orders.home) == (Phase.RUNNING, (1.0, 1.0))


def test_an_exploration_goes_on_without_its_home():
    mission = Mission("exploration")
    mission.start()
    mission.begun((0.0, 0.0))
    mission.forget_home()
    assert (mission.orders.phase, mission.orders.home) == (Phase.RUNNING, None)


def test_commands_that_make_no_sense_now_say_what_to_send_instead():
    mission = Mission("exploration")
    for act, words in (
        (mission.pause, "nothing to pause, the robot is idle: send `start`"),
        (mission.resume, "nothing to resume"),
        (mission.return_home, "no home yet"),
        (Mission("navigation").explore, "decision.task=exploration"),
    ):
        with pytest.raises(CommandError, match=words):
            act()
    assert mission.orders.phase is Phase.IDLE


def test_navigation_needs_a_target_and_takes_new_ones_on_its_way():
    mission = Mission("navigation")
    with pytest.raises(CommandError, match="goal X Y"):
        mission.start()
    mission.goal((4.0, 2.0))
    assert mission.orders.phase is Phase.IDLE
    mission.start()
    episode = mission.orders.episode
    mission.goal((5.0, 2.0))
    assert mission.orders.target == (5.0, 2.0)
    assert mission.orders.episode > episode
    mission.end(Phase.FINISHED, "there", mission.orders.episode)
    mission.goal((6.0, 2.0))
    assert mission.orders.phase is Phase.RUNNING
    with pytest.raises(CommandError, match="finite"):
        mission.goal((float("nan"), 0.0))


def test_an_exploration_is_left_for_a_target_and_taken_up_again():
    mission = Mission("exploration")
    mission.start()
    episodes = [mission.orders.episode]
    mission.goal((4.0, 2.0))
    assert (mission.orders.task.name, mission.orders.target) == ("navigation", (4.0, 2.0))
    mission.start()
    assert mission.orders.task.name == "navigation"
    episodes.append(mission.orders.episode)
    mission.explore()
    assert (mission.orders.phase, mission.orders.task.name, mission.orders.target) == (
        Phase.RUNNING,
        "exploration",
        None,
    )
    episodes.append(mission.orders.episode)
    mission.explore()
    assert mission.orders.episode == episodes[-1]
    mission.goal((5.0, 2.0))
    mission.end(Phase.FINISHED, "there", mission.orders.episode)
    episodes.append(mission.orders.episode)
    mission.start()
    assert (mission.orders.task.name, mission.orders.target) == ("exploration", None)
    assert len({*episodes, mission.orders.episode}) == 5


@pytest.mark.parametrize("before", ["idle", "paused", "aborted"])
def test_a_target_given_to_a_robot_that_waits_is_gone_to_when_it_starts(before):
    mission = Mission("exploration")
    if before != "idle":
        mission.start()
        mission.pause() if before == "paused" else mission.abort()
    episode = mission.orders.episode
    mission.goal((4.0, 2.0))
    assert not mission.orders.moving
    mission.start()
    assert (mission.orders.phase, mission.orders.task.name) == (Phase.RUNNING, "navigation")
    assert mission.orders.episode > episode


def test_nobody_waits_for_a_target_on_the_way_home():
    mission = Mission("exploration")
    mission.start()
    mission.begun((0.0, 0.0))
    mission.return_home()
    mission.goal((4.0, 2.0))
    assert mission.orders.phase is Phase.RUNNING
    mission.return_home()
    mission.explore()
    assert (mission.orders.phase, mission.orders.task.name) == (Phase.RUNNING, "exploration")


@pytest.mark.parametrize(
    ("text", "verb", "arguments"),
    [
        ("pause", "pause", {}),
        (" Return-Home ", "return_home", {}),
        ("goal 3.5 -2", "goal", {"x": "3.5", "y": "-2"}),
        ("goal 3.5,-2", "goal", {"x": "3.5", "y": "-2"}),
        ("stop a person is there", "stop", {"reason": "a person is there"}),
    ],
)
def test_commands_are_read_as_people_write_them(text, verb, arguments):
    assert parse(text) == (verb, arguments)


@pytest.mark.parametrize("text", ["goal 3", "goal", "pause now", "goal 1 2 3"])
def test_words_too_many_or_too_few_are_refused(text):
    with pytest.raises(CommandError):
        parse(text)


def test_an_exploration_has_no_target_even_if_one_is_named():
    assert Mission("exploration", (3.0, 4.0)).orders.target is None
    assert Mission("navigation", (3.0, 4.0)).orders.target == (3.0, 4.0)
