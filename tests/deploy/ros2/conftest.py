import pytest

from tests.deploy.ros2.network import rmw_router


@pytest.fixture(scope="module")
def endpoint():
    with rmw_router() as address:
        yield address
