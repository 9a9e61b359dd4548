"""Processes that are killed, and what becomes of their children."""

import os
import signal
import time

import psutil

from common.system.reaper import Reaper
from tests.common.bus.processes import eventually, python

PARENT = """
import subprocess, sys, time
from common.system.reaper import Reaper

reaper = Reaper(grace=0.5)
for code in sys.argv[1:]:
    child = subprocess.Popen([sys.executable, "-c", code], stdout=sys.stdout, process_group=reaper.group())
sys.stdin.read()
reaper.close()
"""
CHILD = "import os, signal, time; {}; os.write(1, b'%d\\n' % os.getpid()); time.sleep(600)"
DEAF = "signal.signal(signal.SIGTERM, signal.SIG_IGN)"


def gone(pid):
    return not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE


def test_children_that_hear_nothing_end_with_their_killed_parent():
    with python(PARENT, CHILD.format(DEAF), CHILD.format(DEAF)) as parent:
        children = [int(parent.stdout.readline()) for _ in range(2)]
        os.kill(children[0], signal.SIGSTOP)
        family = [child.pid for child in psutil.Process(parent.pid).children(recursive=True)]
        assert set(children) < set(family)
        began = time.monotonic()
        parent.kill()
        parent.wait()
        assert eventually(lambda: all(gone(pid) for pid in family), 5.0)
        assert time.monotonic() - began < 3.0


def test_a_parent_that_ends_in_order_has_its_children_to_itself():
    with python(PARENT, CHILD.format(DEAF)) as parent:
        child = int(parent.stdout.readline())
        reaper = [each for each in psutil.Process(parent.pid).children() if each.pid != child]
        parent.stdin.close()
        parent.wait(10)
        time.sleep(1.0)
        assert all(gone(each.pid) for each in reaper)
        assert not gone(child)
        os.kill(child, signal.SIGKILL)


def test_a_reaper_that_is_gone_is_made_again():
    with Reaper() as reaper:
        first = reaper.group()
        assert reaper.group() == first
        os.kill(first, signal.SIGKILL)
        assert eventually(lambda: reaper.group() != first)
        assert not gone(reaper.group())
