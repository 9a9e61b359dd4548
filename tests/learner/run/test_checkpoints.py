import json
import random
import subprocess
import sys
import textwrap
import time

import pytest
import torch

from common.errors import CheckpointError
from learner.run.checkpoints import CheckpointStore


def tensors(value):
    return {"weights": torch.full((40, 3), float(value)), "count": torch.tensor(value)}


def test_a_checkpoint_comes_back_equal(tmp_path):
    store = CheckpointStore(tmp_path, keep=3)
    document = {"rng": {"state": 2**127 + 1}, "rate": 0.1, "name": None}
    store.save(12, tensors(7), document)
    loaded = store.load_newest()
    assert loaded.name == "000000012"
    assert loaded.document == document
    assert torch.equal(loaded.tensors["weights"], tensors(7)["weights"])
    assert loaded.tensors["count"].item() == 7
    assert store.pointer("last") == "000000012"
    assert store.pointer("best") is None


def test_shared_and_strided_tensors_are_stored_by_value(tmp_path):
    base = torch.arange(12.0).reshape(3, 4)
    store = CheckpointStore(tmp_path, keep=2)
    store.save(1, {"a": base, "b": base.T, "c": base[1]}, {})
    loaded = store.load_newest().tensors
    assert torch.equal(loaded["b"], base.T) and torch.equal(loaded["c"], base[1])


def test_the_newest_are_kept_beside_the_best(tmp_path):
    store = CheckpointStore(tmp_path, keep=2)
    for update in range(1, 6):
        store.save(update, tensors(update), {})
        store.save_best(update * 10, tensors(update), {"score": update})
    assert store.names() == ["000000004", "000000005"]
    assert store.pointer("best") == "policy-000000050"
    assert store.load(store.pointer("best")).document == {"score": 5}
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"000000004", "000000005", "policy-000000050", "last", "best"}


@pytest.mark.parametrize("damage", ["flip", "truncate", "missing", "manifest", "nested manifest"])
def test_a_damaged_newest_checkpoint_is_named_and_the_one_before_used(tmp_path, caplog, damage):
    store = CheckpointStore(tmp_path, keep=3)
    store.save(1, tensors(1), {"n": 1})
    newest = store.save(2, tensors(2), {"n": 2})
    path = newest / "tensors.safetensors"
    content = bytearray(path.read_bytes())
    if damage == "flip":
        content[-1] ^= 1
        path.write_bytes(content)
    elif damage == "truncate":
        path.write_bytes(content[:-5])
    elif damage == "missing":
        path.unlink()
    else:
        (newest / "manifest.json").write_text("{" if damage == "manifest" else "[" * 100_000)
    loaded = store.load_newest()
    assert loaded.document == {"n": 1}
    assert "000000002" in caplog.text and "continuing from checkpoint 000000001" in caplog.text
    store.set_aside_after(loaded.name)
    assert store.names() == ["000000001"]
    assert (tmp_path / "damaged-000000002").is_dir()


@pytest.mark.parametrize("damage", [b"", bytes(4096), b"\xff\xfe", b"../../secret", None], ids=str)
def test_damaged_pointers_are_put_right_from_what_is_there(tmp_path, damage, caplog):
    store = CheckpointStore(tmp_path, keep=3)
    for update in (1, 2):
        store.save(update, tensors(update), {})
        store.save_best(update * 10, tensors(update), {"version": update})
    for which in ("last", "best"):
        (tmp_path / which).unlink() if damage is None else (tmp_path / which).write_bytes(damage)
    beside = CheckpointStore(tmp_path, keep=3, writer=False)
    assert (beside.pointer("last"), beside.pointer("best")) == ("000000002", "policy-000000020")
    assert "is damaged" in caplog.text
    CheckpointStore(tmp_path, keep=3)
    assert (tmp_path / "last").read_text() == "000000002\n"
    assert (tmp_path / "best").read_text() == "policy-000000020\n"


def test_a_checkpoint_that_was_being_replaced_comes_back(tmp_path):
    store = CheckpointStore(tmp_path, keep=3)
    store.save(1, tensors(1), {"n": 1})
    # The writer died between taking the old folder away and putting the new one in its place.
    (tmp_path / "000000001").rename(tmp_path / ".000000001.replaced.tmp")
    assert CheckpointStore(tmp_path, keep=3).load_newest().document == {"n": 1}
    store.save(1, tensors(2), {"n": 2})
    assert {path.name for path in tmp_path.iterdir()} == {"000000001", "last"}
    assert store.load_newest().document == {"n": 2}


def test_no_usable_checkpoint_is_an_error(tmp_path):
    store = CheckpointStore(tmp_path, keep=3)
    with pytest.raises(CheckpointError, match="there is no checkpoint"):
        store.load_newest()
    folder = store.save(1, tensors(1), {})
    (folder / "state.json").unlink()
    with pytest.raises(CheckpointError, match=r"no checkpoint .* is usable.*state\.json is missing"):
        store.load_newest()


def test_a_checkpoint_of_another_format_is_refused(tmp_path):
    folder = CheckpointStore(tmp_path, keep=3).save(1, tensors(1), {})
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps(manifest | {"format": 99}))
    with pytest.raises(CheckpointError, match="format 99, this software reads format 1"):
        CheckpointStore(tmp_path, keep=3).load("000000001")


@pytest.mark.parametrize("entry", [5, {}, None])
def test_a_manifest_without_a_digest_is_damage(tmp_path, entry):
    store = CheckpointStore(tmp_path, keep=3)
    folder = store.save(1, tensors(1), {})
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["files"]["state.json"] = entry
    (folder / "manifest.json").write_text(json.dumps(manifest))
    assert "gives no digest of state.json" in store.damaged()[folder.name]


def test_kill_at_any_moment_of_writing_leaves_a_sound_checkpoint(tmp_path):
    # One process has torch ready; the writers that are killed are copies of it.
    program = textwrap.dedent("""
        import os, sys
        from pathlib import Path
        import torch
        from learner.run.checkpoints import CheckpointStore
        torch.set_num_threads(1)
        def write():
            store = CheckpointStore(Path(sys.argv[1]), keep=2)
            first = int(store.names()[-1]) if store.names() else 0
            for update in range(first + 1, 10**9):
                store.save(update, {"w": torch.full((200_000,), float(update))}, {"n": update})
                os.write(1, b"%d\\n" % update)
        for order in sys.stdin:
            child = os.fork()
            if not child:
                write()
            sys.stdin.readline()
            os.kill(child, 9)
            os.waitpid(child, 0)
            os.write(1, b"killed\\n")
    """)
    random.seed(0)
    command = [sys.executable, "-c", program, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:

        def order():
            process.stdin.write("\n")
            process.stdin.flush()

        for _ in range(5):
            order()
            saved = int(process.stdout.readline())
            time.sleep(random.uniform(0.0, 0.05))
            order()
            while (line := process.stdout.readline()) != "killed\n":
                saved = int(line)
            loaded = CheckpointStore(tmp_path, keep=2).load_newest()
            assert loaded.document["n"] in (saved, saved + 1)
            assert torch.all(loaded.tensors["w"] == float(loaded.document["n"]))
            assert not [path for path in tmp_path.iterdir() if path.name.endswith(".tmp") and path.is_dir()]
            assert (tmp_path / "last").exists()
