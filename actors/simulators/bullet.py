"""The one place that imports PyBullet, and opens its physics servers."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import threading
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from common.errors import SimulatorError


@contextlib.contextmanager
def _native_stderr_closed() -> Iterator[None]:
    """Send what C code writes to stderr nowhere: PyBullet greets with its build time at every import."""
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


with _native_stderr_closed():
    import pybullet

__all__ = ["collision_mesh", "connect", "disconnect", "pybullet", "visual_mesh"]

# PyBullet never lets go of the vertex lists that it was given. So all meshes of a process go through these: what
# leaks is a count of references, not memory.
_lock = threading.Lock()
_vertex_pool: list[list[float]] = []
_vertices: list[list[float]] = []
_normal_pool: list[list[float]] = []
_normals: list[list[float]] = []
_indices: list[int] = []


def connect(gui: bool) -> int:
    """Open a physics server of our own and return its client number.

    Raises:
        SimulatorError: there is no display for ``gui``, another window is open in this process, or no server is left.
    """
    if not gui:
        client = int(pybullet.connect(pybullet.DIRECT))
        if client < 0:
            raise SimulatorError("PyBullet has no physics server left in this process: close() simulators not in use")
        return client
    _require_display()
    try:
        client = int(pybullet.connect(pybullet.GUI))
    except pybullet.error as error:
        raise SimulatorError(_NO_WINDOW) from error
    if client < 0:
        raise SimulatorError(_NO_WINDOW)
    return client


_NO_WINDOW = "PyBullet could not open a window: it allows one per process; close the other, or leave --gui out"


def collision_mesh(client: int, vertices: NDArray[np.float64], indices: NDArray[np.integer]) -> int:
    """Make a concave triangle mesh to collide with and return its shape number, negative when PyBullet refuses.

    Args:
        client: physics client.
        vertices: metres, shape (n, 3).
        indices: three per triangle, flat.
    """
    with _lock:
        _fill(vertices, indices)
        return int(
            pybullet.createCollisionShape(
                pybullet.GEOM_MESH,
                vertices=_vertices,
                indices=_indices,
                flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
                physicsClientId=client,
            )
        )


def visual_mesh(
    client: int,
    vertices: NDArray[np.float64],
    indices: NDArray[np.integer],
    colour: tuple[float, float, float, float],
) -> int:
    """Make a mesh of quads to look at, RGBA ``colour``, four vertices per quad; otherwise as `collision_mesh`."""
    quads = vertices.reshape(-1, 4, 3)
    normals = np.cross(quads[:, 1] - quads[:, 0], quads[:, 2] - quads[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    with _lock:
        _fill(vertices, indices)
        _take(_normal_pool, _normals, np.repeat(normals, 4, axis=0))
        return int(
            pybullet.createVisualShape(
                pybullet.GEOM_MESH,
                vertices=_vertices,
                indices=_indices,
                normals=_normals,
                rgbaColor=colour,
                specularColor=(0.1, 0.1, 0.1),
                physicsClientId=client,
            )
        )


def _fill(vertices: NDArray[np.float64], indices: NDArray[np.integer]) -> None:
    _take(_vertex_pool, _vertices, vertices)
    _indices[:] = indices.tolist()


def _take(pool: list[list[float]], out: list[list[float]], points: NDArray[np.float64]) -> None:
    pool.extend([0.0, 0.0, 0.0] for _ in range(len(points) - len(pool)))
    for slot, point in zip(pool, points.tolist(), strict=False):
        slot[:] = point
    out[:] = pool[: len(points)]


def disconnect(client: int) -> None:
    """Close a physics server with everything in it."""
    pybullet.disconnect(physicsClientId=client)


def _require_display() -> None:
    """Raise `SimulatorError` when X cannot be reached: PyBullet itself would end the whole process."""
    if not sys.platform.startswith("linux"):
        return
    name = os.environ.get("DISPLAY")
    if not name:
        raise SimulatorError(
            "PyBullet's window needs an X display and DISPLAY is not set: run from a desktop session or with "
            "xvfb-run, or leave --gui out"
        )
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError as error:
        raise SimulatorError("PyBullet's window needs libX11 (apt install libx11-6 libgl1)") from error
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    display = x11.XOpenDisplay(None)
    if not display:
        raise SimulatorError(f"PyBullet's window needs an X display and {name!r} (DISPLAY) cannot be opened")
    x11.XCloseDisplay(display)
