"""Explore a generated place with the policy that ships, and draw what the robot knows and where it drove.

Run it as ``python examples/plan_on_a_map.py``; it writes plan.png.
"""

import numpy as np
from PIL import Image, ImageDraw

from hdplanner import GridSimulator, Mapper, MappingConfig, SimulatorConfig, make_planner, open_sources

config = MappingConfig()
world = open_sources(["generator:rooms?width=480&height=320"], None, "exploration").world(7)
robot = GridSimulator(SimulatorConfig(name="grid"), config.sensor_range)
pose = robot.reset(world, seed=0)
mapper = Mapper(config, lattice_origin=world.lattice_origin)
planner = make_planner("hdplanner", config)
planner.reset("exploration", target=None, seed=0)

way = [pose.position]
while True:
    mapper.integrate(robot.scan(), pose)
    mapper.update(pose)
    plan = planner.plan(mapper, pose)
    if plan.waypoint is None:
        break
    for place in [*plan.via, plan.waypoint]:
        pose = robot.drive_to(place).pose
        way.append(pose.position)

belief = mapper.belief
grey = np.select([belief.cells < 0, belief.cells == 0], [160, 255], 0).astype(np.uint8)
picture = Image.fromarray(grey[::-1]).convert("RGB")
pixels = [((x - belief.origin[0]) / belief.resolution, (y - belief.origin[1]) / belief.resolution) for x, y in way]
ImageDraw.Draw(picture).line([(x, picture.height - y) for x, y in pixels], fill=(179, 38, 30), width=2)
picture.save("plan.png")
print(f"{plan.status.value} after {len(way) - 1} legs: {plan.reason}; see plan.png")
