import os
import select
import signal
import subprocess
import sys
import threading

import pytest

from common.system.signals import on_signals, stopping_signals


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_stops_in_order(number):
    stop = threading.Event()
    before = signal.getsignal(number)
    with stopping_signals(stop.set, stop.is_set):
        signal.raise_signal(number)
        assert stop.is_set()
    assert signal.getsignal(number) is before


def test_a_second_interrupt_does_not_wait():
    stop = threading.Event()
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), stopping_signals(stop.set, stop.is_set):
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_only_the_signals_named_are_taken_and_given_back_after_an_error():
    heard = []
    before = signal.getsignal(signal.SIGUSR1), signal.getsignal(signal.SIGUSR2)
    with pytest.raises(RuntimeError), on_signals(heard.append, signal.SIGUSR1):
        assert signal.getsignal(signal.SIGUSR2) is before[1]
        signal.raise_signal(signal.SIGUSR1)
        raise RuntimeError
    assert heard == [signal.SIGUSR1]
    assert signal.getsignal(signal.SIGUSR1) is before[0]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the request is one of Linux")
def test_a_process_is_terminated_with_its_parent():
    child = "import time, common.system.signals as s; s.terminate_with_parent(); print(1, flush=True); time.sleep(60)"
    parent = (
        "import subprocess, sys; "
        f"child = subprocess.Popen([sys.executable, '-c', {child!r}], stdin=subprocess.PIPE, stdout=subprocess.PIPE); "
        "print(child.pid, child.stdout.readline().decode(), flush=True); input()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", parent], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        child_pid = int(process.stdout.readline().split()[0])
        descriptor = os.pidfd_open(child_pid)
        process.kill()
        process.wait()
    try:
        assert select.select([descriptor], [], [], 10.0)[0], "the child outlived its parent"
    finally:
        os.close(descriptor)


HUNG_UP = """
import fcntl, sys, termios, threading, time
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from common.system.entry import ended_by_signals
with ended_by_signals():
    from common.system.signals import stopping_signals
    if sys.argv[1] == "in order":
        stop = threading.Event()
        with stopping_signals(stop.set, stop.is_set):
            print("runs", flush=True)
            # Short waits: a signal just before a long one would be heard at its end only.
            while not stop.wait(0.05):
                pass
        print("ends", flush=True)
    else:
        print("runs", flush=True)
        try:
            while True:
                time.sleep(0.05)
        finally:
            print("clears away", flush=True)
"""


@pytest.mark.parametrize(("how", "status"), [("in order", 0), ("at once", 129)])
def test_a_terminal_that_is_closed_ends_what_runs_in_it_as_a_termination_does(how, status):
    master, slave = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", HUNG_UP, how],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
    )
    with process:
        os.close(slave)
        assert b"runs" in os.read(master, 100)
        os.close(master)
        assert process.wait(30.0) == status


def test_what_runs_under_nohup_stays():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        stop = threading.Event()
        with stopping_signals(stop.set, stop.is_set):
            signal.raise_signal(signal.SIGHUP)
        assert not stop.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)
