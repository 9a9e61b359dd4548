import os
import tempfile
from pathlib import Path

import pytest

from tests.deploy.ros2.network import rmw_router

# pyzeros compiles codecs; they go into the working directory unless told otherwise.
os.environ.setdefault("CYDR_CACHE_DIR", str(Path(tempfile.gettempdir()) / "hdplanner-cydr"))


@pytest.fixture(scope="module")
def endpoint():
    with rmw_router() as address:
        yield address
