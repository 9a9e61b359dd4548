"""A planner of one's own: it goes where most is to be seen for the way. Compared with a classical one here.

Run it as ``python examples/own_planner.py``. The commands take it by name, from this folder::

    hd-eval run --planner own_planner:CuriousPlanner,nearest --maps generator:office --limit 5 --out results/
    hd-deploy bridge --planner own_planner:CuriousPlanner

A planner with ways of its own needs no base class: whatever has `name`, `tasks`, `reset` and `plan` is one (see
`hdplanner.Planner`).
"""

import numpy as np
from numpy.typing import NDArray

from hdplanner import Mapper, Pose, ViewpointPlanner, evaluate


class CuriousPlanner(ViewpointPlanner):
    """Goes to the viewpoint with the most frontier in sight for each metre of the way, 10 m more for every one."""

    name = "curious"

    def choose(
        self, mapper: Mapper, pose: Pose, candidates: NDArray[np.int64], positions: NDArray[np.float64]
    ) -> list[int]:
        """Return the node to go to; candidates are the viewpoints that still observe frontiers."""
        del pose, positions
        frontiers = mapper.observe().utility[candidates]
        metres = mapper.distances(mapper.robot)[candidates]
        return [int(candidates[np.argmax(frontiers / (metres + 10.0))])]


def main() -> None:
    """Drive both planners in the same three worlds."""
    worlds = ["generator:rooms?width=480&height=320"]
    for planner in (CuriousPlanner, "nearest"):
        results = evaluate(planner, worlds, count=3)
        name = planner if isinstance(planner, str) else planner.name
        metres = sum(result.distance_m for result in results)
        print(f"{name:10} {sum(result.success for result in results)} of 3 worlds explored, {metres:.0f} m driven")


if __name__ == "__main__":
    main()
