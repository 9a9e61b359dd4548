import json
import resource
import time

import pytest

from common.system.documents import MAX_BYTES, DocumentError, parse_json, parse_toml, read_json, read_text


@pytest.mark.parametrize(
    "text",
    [
        "[" * 500_000,
        "[" * 40 + "]" * 40,
        '{"a":' * 40 + "1" + "}" * 40,
        "1e999",
        "[NaN]",
        "-Infinity",
        "9" * 100_000,
        '"open',
        '{"twice": 1, "twice": 2}',
        "{" + ",".join(f'"{key % 60_000}": 0' for key in range(60_001)) + "}",
        b"\xff\xfe",
    ],
    ids=lambda text: repr(text[:8]),
)
def test_hostile_json_is_refused_in_one_sentence(text):
    began = time.process_time()
    with pytest.raises(DocumentError) as caught:
        parse_json(text)
    assert time.process_time() - began < 1.0
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 100_000,
        "a" + ".a" * 40_000 + " = 1",
        "[" + "a." * 40_000 + "a]",
        "a" + " . a" * 30_000 + " = 1",
        "a = " + "{a = " * 2_000 + "1" + "}" * 2_000,
        'a = """' + "x" * 200_000,
        "\n".join(f"[{'a.' * 30}k{i}]" for i in range(100_000)),
        "a = 1\na = 2",
        "key",
    ],
    ids=lambda text: repr(text[:8]),
)
def test_hostile_toml_is_refused_in_one_sentence(text):
    began = time.process_time()
    with pytest.raises(DocumentError) as caught:
        parse_toml(text)
    assert time.process_time() - began < 1.0
    assert "\n" not in str(caught.value)


def test_large_but_honest_toml_is_quick():
    began = time.process_time()
    text = "\n".join(f'[worlds."plan-{i}.pgm"]\nstart = [1.5, 2.0]' for i in range(2_500))
    assert len(parse_toml(text)["worlds"]) == 2_500
    assert time.process_time() - began < 2.0


def test_a_file_without_end_is_not_read_to_its_end(tmp_path):
    endless = tmp_path / "endless.json"
    with endless.open("wb") as file:
        file.truncate(1 << 40)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DocumentError, match=f"at most {MAX_BYTES:,} bytes"):
        read_json(endless)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000
    (tmp_path / "latin.json").write_bytes('"é"'.encode("latin-1"))
    with pytest.raises(DocumentError, match="UTF-8"):
        read_text(tmp_path / "latin.json")


def test_plain_documents_come_through(tmp_path):
    values = {"a": [1, 2.5, None, {"b": True}], "text": "ü"}
    (tmp_path / "plain.json").write_text(json.dumps(values), "utf-8")
    assert read_json(tmp_path / "plain.json") == values
    assert parse_toml("a = 1\n[b.c]\nd = 'x'") == {"a": 1, "b": {"c": {"d": "x"}}}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 3\n", "pointer of Git LFS"),
        (b"\n<!DOCTYPE HTML>\n<title>Sign in</title>", "web page"),
    ],
)
def test_what_lies_in_the_place_of_a_document_is_told(tmp_path, data, words):
    path = tmp_path / "settings.toml"
    path.write_bytes(data)
    with pytest.raises(DocumentError, match=words):
        read_text(path)
