import subprocess
import sys

import pytest

from common.errors import LockedError
from common.system.file_lock import FileLock

HOLD = (
    "import sys; from pathlib import Path; from common.system.file_lock import FileLock; "
    "lock = FileLock(Path(sys.argv[1])); "
)


def test_one_process_holds_it_at_a_time(tmp_path):
    path = tmp_path / "lock"
    command = [sys.executable, "-c", HOLD + "print('held', flush=True); sys.stdin.read()", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(LockedError, match=f"locked by process {process.pid}") as caught:
            FileLock(path)
        assert caught.value.holder == str(process.pid)
        process.kill()
    # It ends with its process, however that ended.
    with FileLock(path), pytest.raises(LockedError):
        FileLock(path)
    FileLock(path).close()


def test_closing_twice_is_harmless(tmp_path):
    lock = FileLock(tmp_path / "lock")
    lock.close()
    lock.close()


def test_a_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(FileNotFoundError):
        FileLock(tmp_path / "nowhere" / "lock")
