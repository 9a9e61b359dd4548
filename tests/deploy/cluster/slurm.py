"""Slurm of one node on this machine: munged, slurmctld and slurmd with all their files in one folder."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.common.bus.processes import eventually

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "scancel", "scontrol", "squeue")
_SETTINGS = """ClusterName=test
SlurmctldHost={host}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.sock
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SchedulerParameters=requeue_delay=1
KillWait=60
SlurmdParameters=config_overrides
NodeName={host} CPUs=16 RealMemory=100000 State=UNKNOWN
PartitionName=main Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def missing() -> str:
    """Return why Slurm cannot be run here; empty when it can."""
    path = os.environ["PATH"] + ":/usr/sbin"
    absent = [name for name in PROGRAMS if shutil.which(name, path=path) is None]
    if absent:
        return f"{', '.join(absent)} not installed: apt-get install slurmctld slurmd slurm-client munge"
    return "" if os.geteuid() == 0 else "the daemons of Slurm are run as root here"


class Slurm:
    """The commands of Slurm, and what they know of jobs."""

    def __init__(self, folder: Path) -> None:
        self._environment = os.environ | {
            "SLURM_CONF": str(folder / "slurm.conf"),
            "PATH": os.environ["PATH"] + ":/usr/sbin",
        }
        self.folder = folder

    def submit(self, script: Path, *options: str, **settings: str) -> str:
        """Queue a script with settings in its environment; return the number of its job."""
        export = ",".join(["ALL", *(f"{name}={value}" for name, value in settings.items())])
        command = ["sbatch", "--parsable", f"--export={export}", f"--chdir={self.folder}", *options, str(script)]
        return self.run(*command).strip()

    def state(self, job: str) -> str:
        """Return the state of a job, such as RUNNING."""
        return self.run("squeue", "--noheader", "--format=%T", "--jobs", job).strip()

    def run(self, *command: str) -> str:
        """Run a command of Slurm and return what it prints."""
        done = subprocess.run(command, env=self._environment, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, f"{' '.join(command)}: {done.stderr}"
        return done.stdout


@contextmanager
def slurm_here(folder: Path) -> Iterator[Slurm]:
    """Run a cluster of this machine alone within the `with`; its jobs are cancelled at the end."""
    host = socket.gethostname().split(".")[0]
    with socket.socket() as one, socket.socket() as two:
        one.bind(("127.0.0.1", 0))
        two.bind(("127.0.0.1", 0))
        ports = one.getsockname()[1], two.getsockname()[1]
    for name in ("state", "spool"):
        (folder / name).mkdir()
    (folder / "slurm.conf").write_text(_SETTINGS.format(host=host, folder=folder, ports=ports))
    key = folder / "munge.key"
    key.write_bytes(os.urandom(1024))
    key.chmod(0o400)
    cluster = Slurm(folder)
    daemons: list[str] = []
    try:
        for name, options in (
            (
                "munged",
                ["--force", f"--key-file={key}", f"--socket={folder}/munge.sock", f"--log-file={folder}/munge.log",
                 f"--pid-file={folder}/munged.pid", f"--seed-file={folder}/munge.seed"],
            ),
            ("slurmctld", ["-c", "-f", f"{folder}/slurm.conf"]),
            ("slurmd", ["-f", f"{folder}/slurm.conf"]),
        ):  # fmt: skip
            cluster.run(name, *options)
            daemons.append(name)
        assert eventually(lambda: "idle" in cluster.run("sinfo", "--noheader"), 60), "the node did not come up"
        yield cluster
    finally:
        if "slurmctld" in daemons:
            cluster.run("scancel", "--full", "--user=root")
            eventually(lambda: not cluster.run("squeue", "--noheader"), 90)
        for name in reversed(daemons):
            pid = folder / f"{name}.pid"
            if pid.exists():
                subprocess.run(["kill", pid.read_text().strip()], check=False)
