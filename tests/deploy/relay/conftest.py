import itertools
import os

import pytest

# Nodes of other machines are no business of these tests.
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
# Above 101 the ports of a DDS domain would be those of other programs.
_DOMAINS = itertools.count(os.getpid())


@pytest.fixture
def domain():
    """A DDS domain of the test's own."""
    return next(_DOMAINS) % 100 + 1


@pytest.fixture(scope="session", autouse=True)
def _logs_of_ros(tmp_path_factory):
    os.environ.setdefault("ROS_LOG_DIR", str(tmp_path_factory.mktemp("ros")))
