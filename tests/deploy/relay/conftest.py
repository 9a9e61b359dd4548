import itertools
import os

import pytest

# Nodes of other machines are no business of these tests.
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
# Above 101 the ports of a DDS domain would be those of other programs. Processes that run tests side by side have a
# parent in common; each takes twenty domains of its own.
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_DOMAINS = itertools.cycle((os.getppid() + 20 * _WORKER + each) % 100 + 1 for each in range(20))


@pytest.fixture
def domain():
    """A DDS domain of the test's own."""
    return next(_DOMAINS)


@pytest.fixture(scope="session", autouse=True)
def _logs_of_ros(tmp_path_factory):
    os.environ.setdefault("ROS_LOG_DIR", str(tmp_path_factory.mktemp("ros")))
