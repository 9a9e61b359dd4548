"""Files that people wrote with the editors that they have."""

import codecs
import json
from pathlib import Path

import pytest

from common.config.load import load_config
from common.errors import ConfigError
from common.system.text_files import decode_text

TEXT = '[learner]\r\nbatch_size = 32  # größer ≥ 16\r\n'  # fmt: skip


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_a_byte_order_mark_tells_the_encoding(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "run.toml"
    file.write_bytes(TEXT.encode(encoding))
    assert load_config(file).learner.batch_size == 32
    file = tmp_path / "run.json"
    file.write_bytes(json.dumps({"learner": {"batch_size": 32}}).encode(encoding))
    assert load_config(file).learner.batch_size == 32


def test_big_endian_is_read_too() -> None:
    assert decode_text(codecs.BOM_UTF16_BE + TEXT.encode("utf-16-be")) == TEXT


@pytest.mark.parametrize(
    "data", [TEXT.encode("latin-1", "replace"), TEXT.encode("utf-16-le"), TEXT.encode("utf-16-be")]
)
def test_what_cannot_be_told_is_refused_with_what_to_do(tmp_path: Path, data: bytes) -> None:
    file = tmp_path / "run.toml"
    file.write_bytes(data)
    with pytest.raises(ConfigError, match="expected text in UTF-8, .*: save it as UTF-8"):
        load_config(file)
