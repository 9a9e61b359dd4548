import numpy as np

from deploy.ros2 import markers
from deploy.ros2.messages import deserialize, serialize

KIND = "visualization_msgs/msg/MarkerArray"
RED = (1.0, 0.0, 0.0, 1.0)
BLUE = (0.0, 0.0, 1.0, 0.5)


def test_a_scene_survives_the_wire():
    positions = np.array([[1.0, 2.0], [3.0, 4.0]])
    scene = markers.markers(
        [
            markers.clear(1.0, "map"),
            markers.spheres(1.0, "map", "viewpoints", positions, 0.2, RED, [RED, BLUE], z=0.5),
            markers.lines(1.0, "map", "edges", np.array([[[0, 0], [1, 1]], [[1, 1], [2, 0]]]), 0.02, RED, [RED, BLUE]),
            markers.cubes(1.0, "map", "frontiers", positions, 0.1, BLUE),
            markers.text(1.0, "map", "state", (0.0, 1.0), "exploring", 0.3, RED),
        ]
    )
    _, spheres, lines, cubes, text = deserialize(serialize(scene, KIND), KIND).markers
    assert [(p.x, p.y, p.z) for p in spheres.points] == [(1.0, 2.0, 0.5), (3.0, 4.0, 0.5)]
    assert [(c.r, c.b, c.a) for c in spheres.colors] == [(1.0, 0.0, 1.0), (0.0, 1.0, 0.5)]
    assert len(lines.points) == len(lines.colors) == 4
    assert lines.points[3].x == 2.0
    assert cubes.color.b == 1.0
    assert text.text == "exploring"
    assert len({marker.id for marker in (spheres, lines, cubes, text)}) == 4
    assert {marker.header.frame_id for marker in (spheres, lines, cubes, text)} == {"map"}
    assert all(marker.pose.orientation.w == 1.0 for marker in (spheres, lines, cubes))


def test_empty_scenes_are_messages_too():
    empty = np.empty((0, 2))
    scene = markers.markers([markers.spheres(0.0, "map", "none", empty, 0.2, RED)])
    assert deserialize(serialize(scene, KIND), KIND).markers[0].points == []
