import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from actors.simulators.wall_mesh import LONGEST_FACE, wall_faces, wall_tops
from tests.actors.simulators.worlds import RESOLUTION, block, hall, make_world

GRIDS = arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))


def test_an_empty_hall_has_four_walls_that_look_inwards():
    world = hall(15.0, 12.0)
    faces = wall_faces(world, bottom=0.0, top=2.0)
    assert len(faces) == 4
    centre = np.array([7.5, 6.0, 1.0])
    a, b, c = faces.corners[:, 0], faces.corners[:, 1], faces.corners[:, 2]
    normals = np.cross(b - a, c - a)
    assert (np.einsum("ij,ij->i", normals, centre - a) > 0).all()
    assert faces.corners[..., 0].min() == 1.0
    assert faces.corners[..., 0].max() == 14.0


def test_a_pillar_of_one_cell_has_four_faces_that_look_outwards():
    world = block(hall(15.0, 12.0), 9.0, 7.0)
    faces = wall_faces(world, bottom=0.0, top=2.0)
    assert len(faces) == 8
    middle = np.array([9.0 + RESOLUTION / 2, 7.0 + RESOLUTION / 2, 1.0])
    near = faces.corners[np.abs(faces.corners.mean(axis=1) - middle).max(axis=1) < RESOLUTION]
    normals = np.cross(near[:, 1] - near[:, 0], near[:, 2] - near[:, 0])
    assert len(near) == 4
    assert (np.einsum("ij,ij->i", normals, middle - near[:, 0]) < 0).all()


@given(GRIDS)
def test_faces_cover_exactly_the_borders_between_free_and_occupied(free):
    world = make_world(free, origin=(-3.0, 2.0))
    faces = wall_faces(world, bottom=0.0, top=1.0)
    padded = np.pad(free, 1)
    borders = np.count_nonzero(padded[1:] != padded[:-1]) + np.count_nonzero(padded[:, 1:] != padded[:, :-1])
    length = np.linalg.norm(faces.corners[:, 1] - faces.corners[:, 0], axis=-1).sum()
    assert np.isclose(length, borders * RESOLUTION)
    covered = set()
    for quad in faces.corners:
        (x0, y0), (x1, y1) = quad[0, :2], quad[1, :2]
        steps = round(np.hypot(x1 - x0, y1 - y0) / RESOLUTION)
        for k in range(steps):
            middle = (x0 + (x1 - x0) * (k + 0.5) / steps, y0 + (y1 - y0) * (k + 0.5) / steps)
            covered.add((round(middle[0] * 8), round(middle[1] * 8)))
            inward = np.array([-(y1 - y0), x1 - x0]) / (steps * RESOLUTION) * 0.1
            assert world.is_free((middle[0] - inward[0], middle[1] - inward[1])) != world.is_free(
                (middle[0] + inward[0], middle[1] + inward[1])
            )
    assert len(covered) == borders


@given(GRIDS)
def test_tops_cover_exactly_the_occupied_cells(free):
    world = make_world(free, origin=(1.0, -2.0))
    painted = np.zeros(free.shape, dtype=int)
    for quad in wall_tops(world, 2.0).corners:
        low, high = world.cell(quad[0, :2] + 1e-6), world.cell(quad[2, :2] - 1e-6)
        painted[low[0] : high[0] + 1, low[1] : high[1] + 1] += 1
    assert (painted == ~free).all()


def test_meshes_are_split_when_they_are_large():
    faces = wall_faces(block(hall(15.0, 12.0), 9.0, 7.0), bottom=0.0, top=2.0)
    meshes = faces.chunks(3)
    assert [len(vertices) for vertices, _ in meshes] == [12, 12, 8]
    assert all(indices.max() == len(vertices) - 1 for vertices, indices in meshes)
    assert sum(len(indices) for _, indices in meshes) == 8 * 6


def test_long_walls_are_cut_into_pieces_that_share_their_corners():
    faces = wall_faces(hall(60.0, 4.0, start=(2.0, 2.0)), bottom=0.0, top=2.0)
    bottom = faces.corners[faces.corners[:, 0, 1] == 1.0]
    bottom = bottom[(bottom[:, 1, 1] == 1.0)]
    ends = np.sort(bottom[:, :2, 0], axis=1)
    ends = ends[np.argsort(ends[:, 0])]
    assert len(ends) == 4
    assert (ends[1:, 0] == ends[:-1, 1]).all()
    assert np.diff(ends, axis=1).max() <= LONGEST_FACE
