"""A file system of a few megabytes, which can be filled and emptied."""

import contextlib
import shutil
import subprocess


class MountRefusedError(Exception):
    """This user may not mount a file system."""


class SmallDisk:
    def __init__(self, path):
        self.path = path
        self._ballast = path / "ballast"

    def fill(self, leave=0):
        size = max(0, shutil.disk_usage(self.path).free - leave)
        # Somebody else may take the last of it meanwhile.
        with contextlib.suppress(OSError), self._ballast.open("wb", buffering=0) as file:
            while size > 0:
                size -= file.write(bytes(min(size, 1 << 20)))

    def empty(self):
        self._ballast.unlink()


@contextlib.contextmanager
def mounted(folder, megabytes):
    """Mount a small disk on a folder, made for it, for the time of a `with`."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except FileNotFoundError as error:
        raise MountRefusedError(str(error)) from None
    if done.returncode:
        raise MountRefusedError(f"mounting a small file system is not allowed here: {done.stderr.strip()}")
    try:
        yield SmallDisk(folder)
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)
