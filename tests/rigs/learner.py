"""One run's learner as a process of its own: started, killed and asked as a user does."""

import json
import socket
import subprocess
import sys
import time

SETTINGS = [
    "network.width=16",
    "network.heads=2",
    "network.layers=1",
    "learner.batch_size=4",
    "learner.threads=1",
    "learner.updates_per_step=0.05",
    "replay.min_steps=16",
    "checkpoints.every_seconds=0.3",
]


class Learner:
    """A learner of the run `test` and its commands.

    Args:
        folder: working folder; the run lies in `runs/test` there.
        settings: of the run, of which some are its bus (`bus.tls_ca=...`).
        scheme: of its endpoint, `tcp` or `tls`.
    """

    def __init__(self, folder, settings=SETTINGS, scheme="tcp"):
        self.folder = folder
        self.settings = settings
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            self.endpoint = f"{scheme}/127.0.0.1:{found.getsockname()[1]}"
        self.log = folder / "learner.log"
        self.process = None

    @property
    def run_folder(self):
        return self.folder / "runs" / "test"

    def command(self, *arguments):
        return [sys.executable, "-m", "learner", *arguments]

    def run(self, *arguments):
        return subprocess.run(self.command(*arguments), cwd=self.folder, capture_output=True, text=True, timeout=100)

    def launch(self, verb):
        settings = [part for setting in self.settings for part in ("--set", setting)] if verb == "start" else []
        with self.log.open("a") as log:
            self.process = subprocess.Popen(
                self.command(verb, "--run", "test", "--listen", self.endpoint, *settings),
                cwd=self.folder,
                stdout=log,
                stderr=log,
            )

    def kill(self):
        self.process.kill()
        self.process.wait()

    def ask(self, verb, *options):
        done = self.run(verb, "--run", "test", "--connect", self.endpoint, "--timeout", "60", *options)
        assert done.returncode == 0, done.stderr + self.log.read_text()
        return done.stdout

    def status(self):
        return json.loads(self.ask("status", "--json"))

    def end(self):
        if self.process is not None and self.process.poll() is None:
            self.kill()


def until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not (found := condition()) and time.monotonic() < deadline:
        time.sleep(0.1)
    return found
