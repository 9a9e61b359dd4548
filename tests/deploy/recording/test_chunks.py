"""Chunks of MCAP files that claim, or turn out, to be far larger than they are."""

import io
import resource
import time

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

from deploy.recording.chunks import MAX_CHUNK, records_in
from deploy.recording.errors import RecordingError
from deploy.recording.reader import read_bag

ZEROS = 1 << 28


def packed(compression):
    """256 MB of zeros as a few kilobytes."""
    piece = bytes(1 << 20)
    if compression == "zstd":
        packer = zstandard.ZstdCompressor().compressobj()
        return b"".join([*(packer.compress(piece) for _ in range(ZEROS >> 20)), packer.flush()])
    packer = lz4.frame.LZ4FrameCompressor()
    return b"".join([packer.begin(), *(packer.compress(piece) for _ in range(ZEROS >> 20)), packer.flush()])


def bag(path, compression, claimed):
    """Write an MCAP file with one such chunk."""
    chunk = Chunk(compression, packed(compression), 1, 0, 0, claimed)
    builder = RecordBuilder()
    chunk.write(builder)
    path.write_bytes(b"\x89MCAP0\r\n" + builder.end())
    return path


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("claimed", [1000, ZEROS, 1 << 40])
def test_a_bomb_is_one_sentence_within_a_second_and_little_memory(tmp_path, compression, claimed):
    path = bag(tmp_path / "bomb.mcap", compression, claimed)
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
    with pytest.raises(RecordingError, match="expected chunks of at most"):
        list(read_bag(path))
    assert time.monotonic() - began < 1.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000


def test_an_unknown_packing_is_told(tmp_path):
    with pytest.raises(RecordingError, match="use zstd or lz4"):
        records_in(Chunk("brotli", b"", 1, 0, 0, 10), tmp_path / "a.mcap")


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_honest_chunks_come_through(tmp_path, compression):
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=MAX_CHUNK // 1000, compression=compression)
    writer.start("ros2")
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    channel = writer.register_channel("/words", "cdr", schema)
    for number in range(500):
        writer.add_message(channel, number, bytes([number % 251]) * 1000, number)
    writer.finish()
    (tmp_path / "whole.mcap").write_bytes(stream.getvalue())
    found = list(read_bag(tmp_path / "whole.mcap"))
    assert [message.time for message in found] == list(range(500))
    assert found[300].payload == bytes([49]) * 1000


def chunked(compression):
    """A bag of 40 messages, four or so a chunk."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=4000, compression=compression)
    writer.start("ros2")
    channel = writer.register_channel("/words", "cdr", writer.register_schema("std_msgs/msg/String", "ros2msg", b""))
    noise = np.random.default_rng(0)
    for number in range(40):
        writer.add_message(channel, number, noise.bytes(1000), number)
    writer.finish()
    return stream.getvalue()


def times(path):
    return [message.time for message in read_bag(path)]


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_of_a_chunk_that_breaks_off_what_is_whole_is_read(tmp_path, compression, caplog):
    whole, path = chunked(compression), tmp_path / "cut.mcap"
    reached = set()
    for length in range(6000, 12_000, 250):
        path.write_bytes(whole[:length])
        found = times(path)
        assert found == list(range(len(found)))
        assert "breaks off near byte" in caplog.text
        reached.add(len(found))
    if compression == CompressionType.NONE:
        assert len(reached) >= 6, "message by message and not chunk by chunk"


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_a_damaged_chunk_costs_no_other(tmp_path, compression, caplog):
    spoilt = bytearray(chunked(compression))
    spoilt[10_000] ^= 0xFF
    (tmp_path / "spoilt.mcap").write_bytes(spoilt)
    found = times(tmp_path / "spoilt.mcap")
    assert found[-1] == 39 and 32 <= len(found) < 40
    assert "a chunk is left out" in caplog.text
