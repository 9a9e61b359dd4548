"""Naming a policy: by its file, or by the task of one that is shipped."""

from __future__ import annotations

from pathlib import Path

import pytest

from common.policies.policy_file import read_card
from common.policies.shipped import policy_path


@pytest.mark.parametrize("task", ["exploration", "navigation"])
def test_the_task_names_the_policy_that_is_shipped_for_it(task: str, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert read_card(policy_path(task)).task == task


def test_everything_else_is_a_file() -> None:
    assert policy_path("runs/a.safetensors") == Path("runs/a.safetensors")
    assert policy_path("~/a.onnx") == Path.home() / "a.onnx"
    assert policy_path(Path("exploration.onnx")) == Path("exploration.onnx")
