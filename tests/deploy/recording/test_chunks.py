"""Chunks of MCAP files that claim, or turn out, to be far larger than they are."""

import io
import resource
import time

import lz4.frame
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
