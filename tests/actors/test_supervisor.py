"""Real processes of `hd-actor` under their supervisor."""

import os
import signal
import time

import psutil
import pytest

from tests.actors.command import Command, gone
from tests.actors.learner_end import LearnerEnd, free_port


@pytest.mark.slow
def test_actors_are_restarted_after_a_kill_and_end_in_order():
    with (
        LearnerEnd(free_port()) as learner,
        Command("--num", "2", "--connect", learner.endpoint, "--name", "desk") as command,
    ):
        both = {"desk-0", "desk-1"}
        assert learner.wait_for(lambda: {d.actor for d in learner.deliveries} == both), command.output
        first = {d.actor: d.incarnation for d in learner.deliveries}
        victim = command.actors()["desk-1"]
        os.kill(victim, signal.SIGKILL)
        assert learner.wait_for(
            lambda: any(d.actor == "desk-1" and d.incarnation != first["desk-1"] for d in learner.deliveries)
        ), command.output
        assert "desk-1 was killed by SIGKILL" in command.output
        assert learner.wait_for(lambda: ("actor", "desk-1") in learner.stats.rows())
        assert learner.wait_for(lambda: learner.stats.rows()["actor", "desk-1"][0].restarts == 1)
        assert "was killed by SIGKILL" in learner.stats.rows()["actor", "desk-1"][0].last_error
        assert {d.incarnation for d in learner.deliveries if d.actor == "desk-0"} == {first["desk-0"]}
        children = command.actors()
        assert set(children) == both
        began = time.monotonic()
        command.process.send_signal(signal.SIGINT)
        assert command.wait(10) == 0, command.output
        assert time.monotonic() - began < 5.0
        assert all(gone(pid) for pid in children.values())
    for actor, incarnation in {(d.actor, d.incarnation) for d in learner.deliveries}:
        numbers = [d.sequence for d in learner.deliveries if (d.actor, d.incarnation) == (actor, incarnation)]
        assert sorted(numbers) == list(range(len(numbers)))


@pytest.mark.slow
def test_actors_end_with_a_supervisor_that_is_killed():
    with LearnerEnd(free_port()) as learner, Command("--connect", learner.endpoint, "--name", "desk") as command:
        assert learner.wait_for(lambda: len(learner.deliveries) > 0), command.output
        (child,) = command.actors().values()
        os.kill(command.process.pid, signal.SIGKILL)
        assert gone(child)


@pytest.mark.slow
def test_even_a_frozen_actor_ends_within_three_seconds_of_its_killed_supervisor():
    with (
        LearnerEnd(free_port()) as learner,
        Command("--num", "2", "--connect", learner.endpoint, "--name", "desk") as command,
    ):
        assert learner.wait_for(lambda: {d.actor for d in learner.deliveries} == {"desk-0", "desk-1"}), command.output
        children = command.actors()
        # As one that compiles a kernel or is in the middle of a call that lets no other thread run.
        os.kill(children["desk-0"], signal.SIGSTOP)
        everybody = [child.pid for child in psutil.Process(command.process.pid).children(recursive=True)]
        began = time.monotonic()
        os.kill(command.process.pid, signal.SIGKILL)
        assert all(gone(pid) for pid in everybody)
        assert time.monotonic() - began < 3.0


@pytest.mark.slow
def test_what_a_user_has_to_mend_ends_the_command():
    with (
        LearnerEnd(free_port()) as learner,
        Command("--connect", learner.endpoint, "--maps", "/no/such/folder") as command,
    ):
        assert command.wait(60) == 1
        assert "/no/such/folder" in command.output
        assert "cannot work" in command.output


@pytest.mark.slow
def test_a_supervisor_waits_for_a_named_run_and_stops_in_time():
    with Command("--run", "later", "--connect", f"tcp/127.0.0.1:{free_port()}") as command:
        deadline = time.monotonic() + 60
        while "waiting for the learner" not in command.output and time.monotonic() < deadline:
            time.sleep(0.1)
        assert "waiting for the learner of run 'later'" in command.output
        began = time.monotonic()
        command.process.send_signal(signal.SIGTERM)
        assert command.wait(10) == 0
        assert time.monotonic() - began < 5.0
