"""Compiled layers: the same updates but for rounding, and a clear word where nothing can be compiled."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from common.config import RunConfig
from common.system.runtime import python_module
from learner.algorithm.factory import make_learner
from tests.transitions import random_transitions

CPU = torch.device("cpu")


def config(compiled: bool) -> RunConfig:
    return RunConfig.model_validate(
        {
            "network": {"width": 16, "heads": 2, "layers": 2, "variant": "hdplanner"},
            "cloning": {"updates": 1},
            "learner": {"precision": "fp32", "compile": compiled},
        }
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # torch's compiler warns of its own modules
@pytest.mark.timeout(300)
def test_a_compiled_learner_makes_the_same_updates() -> None:
    eager, compiled = make_learner(config(False), CPU), make_learner(config(True), CPU)
    assert eager.state()[0].keys() == compiled.state()[0].keys()
    rng = np.random.default_rng(0)
    for size in (6, 9, 4):  # of batches: imitation, then soft actor-critic, each with other numbers of viewpoints
        batch = random_transitions(rng, size, (2, 15), labelled=1.0)
        expected, came = eager.update(batch), compiled.update(batch)
        assert came == pytest.approx(expected, rel=1e-3, abs=1e-5)
    theirs, ours = eager.state()[0], compiled.state()[0]
    assert all(torch.allclose(theirs[name], ours[name], atol=1e-4) for name in theirs)


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_a_machine_without_a_compiler_is_told_before_the_run_is_made(tmp_path: Path) -> None:
    environment = {**os.environ, "CXX": str(tmp_path / "none"), "TORCHINDUCTOR_CACHE_DIR": str(tmp_path / "cache")}
    options = ["--runs", str(tmp_path / "runs"), "--run", "tonight", "--set", "learner.compile=true"]
    options += ["--set", "learner.device=cpu"]
    result = subprocess.run(
        python_module("learner", "start", "--serial", *options), env=environment, capture_output=True, text=True
    )
    assert result.returncode == 1
    assert "install a C++ compiler" in result.stderr
    assert not (tmp_path / "runs" / "tonight").exists()
