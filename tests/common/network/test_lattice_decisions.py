"""On a plain lattice everything is as it was when edges were 20-bit masks over lattice offsets.

`lattice_decisions.npz` holds six random observations, their features, and what the shipped policies decided in them,
all recorded with the last release of that form (commit 06cc791).
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from common.config import NetworkConfig
from common.network.graph_arrays import GraphArrays
from common.observations.observation import ObservationBatch
from common.policies.policy_file import read_policy
from common.policies.shipped import shipped_policy

RECORD = np.load(Path(__file__).with_name("lattice_decisions.npz"))
_COUNT = len(RECORD["batch_count"])
# What observations have had since then; the networks of that time do not read it.
_SINCE = {
    "cell": np.full(_COUNT, 0.0625, dtype=np.float32),
    "reach": np.full(_COUNT, 5.0, dtype=np.float32),
    "route_count": np.zeros(_COUNT, dtype=np.int32),
    "route": np.zeros(0, dtype=np.uint16),
    "image": None,
}
BATCH = ObservationBatch(
    **{
        field.name: _SINCE[field.name] if field.name in _SINCE else RECORD[f"batch_{field.name}"]
        for field in fields(ObservationBatch)
    }
)


def test_features_are_the_same() -> None:
    features = GraphArrays.from_observations(BATCH, NetworkConfig(features="extended")).features
    np.testing.assert_allclose(features, RECORD["features"], rtol=0, atol=1e-7)


@pytest.mark.parametrize("task", ["exploration", "navigation"])
def test_the_shipped_policies_decide_the_same(task: str) -> None:
    policy, _ = read_policy(shipped_policy(task))
    for greedy, what in ((True, ""), (False, "drawn_")):
        decisions = [policy.decide(BATCH[k], greedy=greedy, rng=np.random.default_rng(5)) for k in range(len(BATCH))]
        assert [decision.beacon for decision in decisions] == RECORD[f"{task}_{what}beacon"].tolist()
        assert [decision.waypoint for decision in decisions] == RECORD[f"{task}_{what}waypoint"].tolist()
        # Sums of float32 come out a little different on other processors.
        for name in ("beacon_probabilities", "waypoint_probabilities"):
            found = np.concatenate([getattr(decision, name) for decision in decisions])
            np.testing.assert_allclose(found, RECORD[f"{task}_{name}"], atol=1e-5)
