import os
import signal
import subprocess
import sys
import textwrap

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import CheckpointError
from learner.run.journal import Journal, RecordKind

PAYLOADS = [b"one", b"", b"three" * 1000, bytes(range(256))]


def write(folder, payloads, segment_bytes=1 << 20):
    with Journal(folder, segment_bytes) as journal:
        for payload in payloads:
            journal.append(RecordKind.DELIVERY, payload)


def payloads(journal, first=0):
    return [record.payload for record in journal.read(first)]


def test_records_come_back_in_order_over_segments(tmp_path):
    write(tmp_path, PAYLOADS, segment_bytes=100)
    write(tmp_path, [b"later"])
    with Journal(tmp_path) as journal:
        assert payloads(journal) == [*PAYLOADS, b"later"]
        assert len(journal.segments()) > 2


def test_a_rotation_divides_before_from_after(tmp_path):
    with Journal(tmp_path) as journal:
        journal.append(RecordKind.DELIVERY, b"before")
        position = journal.rotate()
        journal.append(RecordKind.VERSION, b"after")
        assert journal.rotate() == position + 1
        assert payloads(journal, position) == [b"after"]
        assert [record.kind for record in journal.read()] == [RecordKind.DELIVERY, RecordKind.VERSION]
        journal.sync()
        journal.drop_before(position)
        assert payloads(journal) == [b"after"]


@settings(max_examples=30, deadline=None)
@given(cut=st.integers(1, 400))
def test_a_torn_end_costs_the_torn_records_alone(tmp_path_factory, cut):
    folder = tmp_path_factory.mktemp("journal")
    records = [bytes([i]) * 40 for i in range(10)]
    write(folder, records)
    segment = sorted(folder.iterdir())[0]
    os.truncate(segment, max(0, segment.stat().st_size - cut))
    with Journal(folder) as journal:
        kept = payloads(journal)
    whole = (10 * 49 - cut) // 49
    assert kept == records[: max(0, whole)]


def test_damage_in_a_finished_segment_is_named(tmp_path):
    write(tmp_path, [b"a" * 50])
    write(tmp_path, [b"b" * 50])
    first = sorted(tmp_path.iterdir())[0]
    content = bytearray(first.read_bytes())
    content[20] ^= 1
    first.write_bytes(content)
    with Journal(tmp_path) as journal, pytest.raises(CheckpointError, match=rf"{first.name} is damaged at byte 0"):
        payloads(journal)


def test_a_refused_write_leaves_no_trace(tmp_path, monkeypatch):
    with Journal(tmp_path) as journal:
        journal.append(RecordKind.DELIVERY, b"good")
        write = os.write

        def full_disk(descriptor, data):
            write(descriptor, bytes(data)[: len(data) // 2])
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "write", full_disk)
        with pytest.raises(CheckpointError, match="No space left on device; make room"):
            journal.append(RecordKind.DELIVERY, b"refused" * 10)
        monkeypatch.undo()
        journal.append(RecordKind.DELIVERY, b"good again")
    with Journal(tmp_path) as journal:
        assert payloads(journal) == [b"good", b"good again"]


def test_what_a_killed_process_has_appended_is_there(tmp_path):
    program = textwrap.dedent("""
        import sys
        from pathlib import Path
        from learner.run.journal import Journal, RecordKind
        journal = Journal(Path(sys.argv[1]), segment_bytes=5000)
        for number in range(10**9):
            journal.append(RecordKind.DELIVERY, str(number).encode() * 20)
            sys.stdout.write(f"{number}\\n")
            sys.stdout.flush()
    """)
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    acknowledged = -1
    for line in process.stdout:
        acknowledged = int(line)
        if acknowledged == 500:
            process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    with Journal(tmp_path) as journal:
        found = payloads(journal)
    assert found == [str(number).encode() * 20 for number in range(len(found))]
    assert len(found) > acknowledged
