"""`hd-actor` as a process, for tests."""

import re
import subprocess
import sys
import threading
import time

import psutil


class Command:
    """`python -m actors` as a process, with its output."""

    def __init__(self, *arguments):
        self.output = ""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "actors", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.reader = threading.Thread(target=self._read)
        self.reader.start()

    def _read(self):
        with self.process.stdout as lines:
            for line in lines:
                self.output += line

    def actors(self):
        """Process numbers of the actors, by name."""
        found = {}
        for child in psutil.Process(self.process.pid).children():
            line = " ".join(child.cmdline())
            name = re.search(r'"name":"([a-z0-9-]+)"', line)
            if "actors.process" in line and name:
                found[name[1]] = child.pid
        return found

    def wait(self, timeout):
        code = self.process.wait(timeout)
        self.reader.join(5)
        return code

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.reader.join(5)


def gone(pid, timeout=5.0):
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        if not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.05)
    return False
