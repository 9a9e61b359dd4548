import errno
import os
import signal
import struct
import subprocess
import sys
import textwrap
import threading
import time
import zlib
from unittest.mock import Mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import CheckpointError, StorageError
from common.messages.schema import encode
from learner.run import journal as journal_module
from learner.run.files import DAMAGED
from learner.run.group_commit import GroupCommit
from learner.run.journal import Journal
from learner.run.records import RecordKind, encode_record, scan
from tests.learner.runs import episodes

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


RECORD_BYTES = 28 + 1 + 40
"""Head, kind and payload of the records that are damaged below."""


def damaged_journal(folder, damage, count=10):
    """Write ``count`` records of 40 bytes in one segment and let ``damage`` change its bytes; return the payloads."""
    records = [bytes([i]) * 40 for i in range(count)]
    write(folder, records)
    (segment,) = folder.iterdir()
    content = bytearray(segment.read_bytes())
    assert len(content) == count * RECORD_BYTES
    segment.write_bytes(damage(content))
    return records


@settings(max_examples=30, deadline=None)
@given(cut=st.integers(1, 600))
def test_a_torn_end_costs_the_torn_records_alone(tmp_path_factory, cut):
    folder = tmp_path_factory.mktemp("run") / "journal"
    records = damaged_journal(folder, lambda content: content[: max(0, len(content) - cut)])
    with Journal(folder) as journal:
        assert payloads(journal) == records[: (10 * RECORD_BYTES - cut) // RECORD_BYTES]
        assert journal.losses == []
    assert not (folder.parent / DAMAGED).exists()


@settings(max_examples=60, deadline=None)
@given(bit=st.integers(0, 8 * 10 * RECORD_BYTES - 1))
def test_one_bit_costs_one_record(tmp_path_factory, bit):
    def flip(content):
        content[bit // 8] ^= 1 << bit % 8
        return content

    folder = tmp_path_factory.mktemp("run") / "journal"
    records = damaged_journal(folder, flip)
    lost = bit // 8 // RECORD_BYTES
    with Journal(folder) as journal:
        assert payloads(journal) == records[:lost] + records[lost + 1 :]
        (loss,) = journal.losses
    assert (loss.start, loss.length) == (lost * RECORD_BYTES, RECORD_BYTES)
    # How many records a damaged beginning or end has cost cannot be known.
    assert (loss.first, loss.count) == ((lost, 1) if 0 < lost < 9 else (lost or -1, None))
    assert (folder.parent / DAMAGED / loss.file).stat().st_size == RECORD_BYTES


@settings(max_examples=60, deadline=None)
@given(start=st.integers(0, 40 * RECORD_BYTES), length=st.integers(1, 512))
def test_zeros_cost_the_records_that_they_touch(tmp_path_factory, start, length):
    touched = []

    def blank(content):
        zeroed = content[:start] + bytes(min(length, len(content) - start)) + content[start + length :]
        places = [slice(i * RECORD_BYTES, (i + 1) * RECORD_BYTES) for i in range(40)]
        touched.extend(i for i, place in enumerate(places) if content[place] != zeroed[place])
        return zeroed

    folder = tmp_path_factory.mktemp("run") / "journal"
    records = damaged_journal(folder, blank, count=40)
    with Journal(folder) as journal:
        found = payloads(journal)
        lost = journal.losses
    assert found == [record for i, record in enumerate(records) if i not in touched]
    assert sum(loss.length for loss in lost) == RECORD_BYTES * len(touched)
    assert [(loss.first, loss.count) for loss in lost if loss.count] == (
        [(touched[0], len(touched))] if touched and touched[0] > 0 and touched[-1] < 39 else []
    )
    with Journal(folder) as journal:
        assert payloads(journal) == found and journal.losses == []


def test_damage_in_any_segment_is_told_and_costs_nothing_else(tmp_path, caplog):
    folder = tmp_path / "journal"
    write(folder, [bytes([i]) * 40 for i in range(10)], segment_bytes=4 * RECORD_BYTES)
    first, middle, last = sorted(folder.iterdir())
    for segment, place in ((first, 100), (middle, 4 * RECORD_BYTES - 5)):
        content = bytearray(segment.read_bytes())
        content[place] ^= 1
        segment.write_bytes(content)
    last.write_bytes(last.read_bytes() + b"nonsense")
    with Journal(folder) as journal:
        assert [record.payload[0] for record in journal.read()] == [0, 2, 3, 4, 5, 6, 8, 9]
        assert [(loss.first, loss.count) for loss in journal.losses] == [(1, 1), (7, 1), (10, None)]
    assert f"{middle.name} from byte {3 * RECORD_BYTES}, {RECORD_BYTES} bytes: record 7 (damaged)" in caplog.text
    assert (tmp_path / DAMAGED / f"{last.stem}-at-{2 * RECORD_BYTES}.bin").read_bytes() == b"nonsense"


def test_damage_at_the_very_end_tells_whose_messages_were_there(tmp_path, caplog):
    folder = tmp_path / "journal"
    made = episodes(2)
    write(folder, [encode(delivery) for delivery in made])
    (segment,) = folder.iterdir()
    content = bytearray(segment.read_bytes())
    records = list(scan(segment))
    # One bit in the last reward of each of the last two chunks, and the report behind them.
    for record in records[-3:]:
        at = content.index(b"rewards", record.start) + 20 if b"rewards" in record.payload else record.end - 2
        content[at] ^= 1
    segment.write_bytes(content)
    with Journal(folder) as journal:
        (loss,) = journal.losses
    assert (loss.first, loss.count, loss.last) == (len(made) - 3, None, len(made) - 1)
    assert f"records {len(made) - 3} to {len(made) - 1} and possibly others (damaged, by what is left" in caplog.text
    for delivery in made[-3:]:
        assert f"message {delivery.sequence} of 'desk-0' (incarnation 7)" in caplog.text


def test_a_payload_cannot_pose_as_records(tmp_path):
    """Behind damage records are searched for; what an actor sends must not be taken for some."""
    folder = tmp_path / "journal"
    forged = encode_record(bytes(8), 5, RecordKind.VERSION, b"forged")
    write(folder, [b"first", forged * 3, b"last"])
    (segment,) = folder.iterdir()
    content = bytearray(segment.read_bytes())
    content[40] ^= 1
    segment.write_bytes(content)
    with Journal(folder) as journal:
        assert payloads(journal) == [b"first", b"last"]


def test_numbers_go_on_where_the_last_process_left_them(tmp_path):
    for name in (b"a", b"b", b"c"):
        write(tmp_path, [name] * 3)
    numbers = [found.number for path in sorted(tmp_path.iterdir()) for found in scan(path)]
    assert numbers == list(range(9))


def test_a_journal_of_format_3_is_read_and_continued(tmp_path):
    def old_record(payload):
        body = b"\x01" + payload
        return struct.pack("<II", len(body), zlib.crc32(body)) + body

    (tmp_path / "00000004.log").write_bytes(old_record(b"old") + old_record(b"older"))
    (tmp_path / "00000005.log").write_bytes(old_record(b"newer") + old_record(b"torn")[:-2])
    with Journal(tmp_path, aside=tmp_path / "aside") as journal:
        journal.append(RecordKind.DELIVERY, b"new")
        journal.rotate()
        assert payloads(journal) == [b"old", b"older", b"newer", b"new"]
        assert [loss.length for loss in journal.losses] == [11]


def test_damage_while_the_journal_is_open_is_named(tmp_path):
    write(tmp_path, [b"a" * 50])
    with Journal(tmp_path) as journal:
        path = sorted(tmp_path.iterdir())[0]
        content = bytearray(path.read_bytes())
        content[20] ^= 1
        path.write_bytes(content)
        with pytest.raises(CheckpointError, match=rf"{path.name} has been damaged at byte 0.*restart to repair it"):
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
        from learner.run.journal import Journal
        from learner.run.records import RecordKind
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


@pytest.fixture
def syncs(monkeypatch):
    """The descriptors that were synced; an error in `failing` is what the next syncs end with."""
    done = []
    real = journal_module.sync_descriptor

    def sync(descriptor):
        if sync.failing is not None:
            raise sync.failing
        done.append(descriptor)
        real(descriptor)

    sync.failing = None
    sync.done = done
    monkeypatch.setattr(journal_module, "sync_descriptor", sync)
    return sync


def test_what_a_disk_lost_in_a_sync_is_written_again(tmp_path, syncs, caplog):
    """After a failed fsync the system calls pages clean that never reached the disk: only new writes help."""
    with Journal(tmp_path) as journal:
        journal.append(RecordKind.DELIVERY, b"safe")
        journal.sync()
        journal.append(RecordKind.DELIVERY, b"first")
        journal.append(RecordKind.DELIVERY, b"second")
        syncs.failing = OSError(5, "Input/output error")
        for _ in range(3):
            with pytest.raises(StorageError, match="Input/output error"):
                journal.sync()
        assert journal.unsynced
        # What the disk forgot, as a machine would find it after a power failure.
        for path in tmp_path.glob("*.log"):
            os.truncate(path, next(scan(path)).end if b"safe" in path.read_bytes() else 0)
        syncs.failing = None
        journal.sync()
        assert not journal.unsynced
    with Journal(tmp_path) as journal:
        assert payloads(journal) == [b"safe", b"first", b"second"]
    assert caplog.text.count("The learner pauses") == 1


def test_a_journal_that_cannot_sync_bounds_what_waits(tmp_path, syncs, monkeypatch):
    monkeypatch.setattr(journal_module, "MAX_UNSYNCED", 100)
    with Journal(tmp_path) as journal:
        syncs.failing = OSError(28, "No space left on device")
        journal.append(RecordKind.DELIVERY, b"x" * 90)
        with pytest.raises(StorageError):
            journal.sync()
        with pytest.raises(StorageError, match="waits for its disk"):
            journal.append(RecordKind.DELIVERY, b"y" * 20)
        syncs.failing = None
        journal.sync()
        journal.append(RecordKind.DELIVERY, b"y" * 20)


def test_messages_that_come_together_share_a_sync(tmp_path, syncs):
    told = []
    with Journal(tmp_path) as journal, GroupCommit(journal, interval=0.2) as commit:
        journal.append(RecordKind.DELIVERY, b"first")
        commit.when_synced(lambda durable: told.append(("first", durable, len(syncs.done))))
        wait_until(lambda: told)
        for number in range(50):
            journal.append(RecordKind.DELIVERY, b"x")
            commit.when_synced(lambda durable, number=number: told.append((number, durable, len(syncs.done))))
        wait_until(lambda: len(told) == 51)
        assert all(durable for _, durable, _ in told)
        assert [name for name, _, _ in told] == ["first", *range(50)]
        assert told[-1][2] - told[0][2] == 1


def test_nobody_is_told_before_the_sync(tmp_path, monkeypatch):
    may_sync = threading.Event()
    real = journal_module.sync_descriptor

    def slow(descriptor):
        may_sync.wait(10.0)
        real(descriptor)

    with Journal(tmp_path) as journal, GroupCommit(journal, interval=0.01) as commit:
        monkeypatch.setattr(journal_module, "sync_descriptor", slow)
        told = []
        journal.append(RecordKind.DELIVERY, b"x")
        commit.when_synced(told.append)
        time.sleep(0.2)
        assert told == []
        journal.append(RecordKind.DELIVERY, b"appending does not wait for a slow disk")
        may_sync.set()
        wait_until(lambda: told == [True])


def test_who_waits_for_a_disk_that_refuses_is_told_and_the_sync_is_tried_again(tmp_path, syncs, monkeypatch):
    monkeypatch.setattr("learner.run.group_commit.RETRY_SECONDS", 0.05)
    with Journal(tmp_path) as journal, GroupCommit(journal, interval=0.01) as commit:
        syncs.failing = OSError(28, "No space left on device")
        told = []
        journal.append(RecordKind.DELIVERY, b"x")
        commit.when_synced(told.append)
        wait_until(lambda: told == [False])
        syncs.failing = None
        wait_until(lambda: not journal.unsynced)
        commit.when_synced(told.append)
        wait_until(lambda: told == [False, True])


def test_messages_are_told_again_once_files_may_be_opened_again(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("learner.run.group_commit.RETRY_SECONDS", 0.05)
    with Journal(tmp_path) as journal, GroupCommit(journal, interval=0.01) as commit:
        told = []
        with monkeypatch.context() as patch:
            patch.setattr(os, "dup", Mock(side_effect=OSError(errno.EMFILE, "Too many open files")))
            journal.append(RecordKind.DELIVERY, b"x")
            commit.when_synced(told.append)
            wait_until(lambda: told == [False])
        wait_until(lambda: not journal.unsynced)
        commit.when_synced(told.append)
        wait_until(lambda: told == [False, True])
    assert "raise the limit of open files" in caplog.text


def test_an_error_of_one_that_waits_does_not_reach_the_others(tmp_path, caplog):
    def fail(durable):
        raise RuntimeError("gone")

    with Journal(tmp_path) as journal, GroupCommit(journal, interval=0.01) as commit:
        told = []
        journal.append(RecordKind.DELIVERY, b"x")
        commit.when_synced(fail)
        commit.when_synced(told.append)
        wait_until(lambda: told == [True])
    assert "gone" in caplog.text


def wait_until(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)
