"""Small networks on a shared machine: two spinning threads per operation cost far more than they bring."""

import pytest
import torch


@pytest.fixture(autouse=True)
def one_thread():
    """Run each test of the learner with one torch thread."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
