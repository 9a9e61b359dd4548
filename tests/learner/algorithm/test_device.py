import logging

import pytest
import torch

from common.config import load_config
from learner.algorithm import device
from learner.algorithm.device import wants_bf16

CPU = torch.device("cpu")


@pytest.mark.parametrize("native", [True, False])
def test_auto_takes_bf16_only_where_the_processor_has_it(monkeypatch, native) -> None:
    monkeypatch.setattr(device, "cpu_has_bf16", lambda: native)
    assert wants_bf16("auto", CPU) is native
    assert not wants_bf16("fp32", CPU)


def test_who_asks_for_emulated_bf16_is_warned(monkeypatch, caplog) -> None:
    monkeypatch.setattr(device, "cpu_has_bf16", lambda: False)
    with caplog.at_level(logging.WARNING):
        assert wants_bf16("bf16", CPU)
    assert "use auto" in caplog.text


@pytest.mark.parametrize("preset", ["exploration", "navigation", "both", "mix", "ariadne", "ca", "cnn"])
def test_presets_leave_the_arithmetic_to_the_machine(preset) -> None:
    assert load_config(preset=preset).learner.precision == "auto"
