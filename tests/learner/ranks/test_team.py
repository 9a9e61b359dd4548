"""Real helper processes: they share updates, die, come back, and leave the weights of one learner alone."""

from __future__ import annotations

import os
import signal
import threading

import numpy as np
import pytest
import torch

from common.errors import ConfigError
from learner.algorithm.base import NotFiniteError
from learner.algorithm.factory import make_learner
from learner.ranks.team import Team, open_learner
from tests.common.bus.processes import eventually
from tests.learner.runs import small_config
from tests.transitions import random_transitions

CPU = torch.device("cpu")
# A rate of which Adam's whole steps, where a gradient is rounding, are within the tolerance.
RUN = small_config(cloning={"updates": 3, "learning_rate": 1e-5}, adam={"policy": 1e-5, "critic": 1e-5})


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_ranks_die_and_come_back_while_the_run_goes_on_as_one_learner_would() -> None:
    rng = np.random.default_rng(1)
    alone = make_learner(RUN, CPU)
    with Team(RUN, make_learner(RUN, CPU), [CPU] * 3, threads=1) as team:

        def update() -> int:
            """Make the same update with and without helpers; return how many ranks shared it."""
            batch = random_transitions(rng, 6, (2, 15), labelled=1.0)
            figures, wanted = team.update(batch), alone.update(batch)
            ranks = int(figures.pop("ranks/sharing"))
            assert figures == pytest.approx(wanted, rel=1e-3, abs=1e-4)
            return ranks

        assert update() == 1  # nobody waits for helpers
        assert eventually(lambda: update() == 3, 120.0)
        first, second = team.helpers
        os.kill(first, signal.SIGKILL)
        assert update() < 3
        # In the middle of an update: it is made again by those who are left.
        os.kill(second, signal.SIGSTOP)
        killer = threading.Timer(0.3, os.kill, (second, signal.SIGKILL))
        killer.start()
        assert update() < 3
        killer.join()
        assert eventually(lambda: update() == 3, 240.0)
        assert not {first, second} & set(team.helpers)
        for _ in range(3):
            assert update() == 3
        tensors, values = team.state()
        assert values["updates"] == alone.updates
        for name, value in alone.state()[0].items():
            torch.testing.assert_close(tensors[name], value, rtol=1e-2, atol=1e-3)

        # Nothing is learnt from a batch that is not finite, and its rows are those of the whole batch.
        bad = random_transitions(rng, 6, (2, 15), labelled=1.0)
        bad.rewards[4] = np.inf
        bad.next_valid[4] = True
        with pytest.raises(NotFiniteError) as caught:
            team.update(bad)
        assert caught.value.culprits.tolist() == [4]
        with pytest.raises(NotFiniteError):
            alone.update(bad)
        assert update() == 3

        # A state from elsewhere reaches the helpers with the next update.
        team.restore(*make_learner(RUN, CPU).state())
        alone.restore(*make_learner(RUN, CPU).state())
        assert update() == 3
        helpers = team.helpers
    assert eventually(lambda: not any(map(_runs, helpers)))


def test_more_learners_than_a_batch_has_rows_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"learner\.batch_size"), open_learner(RUN, CPU, 5, 1):
        pass


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
