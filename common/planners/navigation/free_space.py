"""What navigation planners in continuous space share: the part of a path that may be driven now, and how it ends."""

from __future__ import annotations

from abc import abstractmethod

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import Box
from common.planners.base import Plan, Position, Status
from common.planners.navigation.base import MAX_PATHS, NavigationPlanner, as_near_as_possible, unreachable
from common.planners.navigation.following import PathFollower
from common.planners.navigation.possible_space import PossibleSpace


class FreeSpacePlanner(NavigationPlanner):
    """A navigation planner whose path may bend anywhere: subclasses plan it, unknown space taken as free.

    Paths keep the robot's radius from what is known to be occupied; `PathFollower` says how much of one is driven.

    Whether there is a way at all is told by the cells: two places are joined where cells in which the robot fits
    connect them. Where the subclass does not find that way, as through a door that leaves no room beside the robot, or
    where the robot stands so near to an obstacle that no straight line may begin there, a shortest way from cell to
    cell is followed instead.
    """

    space: PossibleSpace

    def begin(self, target: Position, seed: int) -> None:
        """Forget everything."""
        del target, seed
        self.space = PossibleSpace(self.config)
        self._follower = PathFollower(self.config, self.space.world)

    def decide(self, mapper: Mapper, pose: Pose, target: Position) -> Plan:
        """Plan a path and return as much of it as may be driven now."""
        if not mapper.segment_free(pose.position, pose.position):
            return Plan(Status.STUCK, reason="the robot touches a cell that is not known to be free")
        if self._asked is not None:
            self._follower.note_stop(pose.distance_to(self._asked[1]))
        for _ in range(MAX_PATHS):
            self.take_in(self.space.update(mapper.belief, pose.position, target))
            path = self._path(pose, target)
            if path is None:
                return Plan(Status.UNREACHABLE, reason=unreachable(mapper, target))
            if as_near_as_possible(pose, path, target, self._follower.near):
                return Plan(Status.COMPLETE, reason="the robot is as near to the target as it fits")
            waypoint = self._follower.reach(mapper, pose, path)
            if waypoint is not None:
                left = path[path.index(waypoint) + 1 :] if waypoint in path else path
                return Plan(Status.GOING, waypoint=waypoint, beacon=target, path=left)
        return Plan(Status.STUCK, reason=f"none of {MAX_PATHS} paths begins in space that is known to be free")

    def give_up(self, waypoint: Position) -> None:
        """Take the place for an obstacle for the rest of the episode."""
        self.space.world.doubt(waypoint, always=True)

    @abstractmethod
    def take_in(self, changed: Box | None) -> None:
        """Note that cells of `space.clear` have changed, all in a box, None when there are none."""

    @abstractmethod
    def route(self, start: Position, goal: Position) -> list[Position] | None:
        """Plan a path through what `space.clear` says is clear.

        Args:
            start: metres, in a cell all of whose points are clear.
            goal: likewise.

        Returns:
            The bends of the path, metres, without the start, the goal last; None when none was found.
        """

    def _path(self, pose: Pose, target: Position) -> list[Position] | None:
        """Return a path to a target, or to where the robot is as near to it as it fits; None when there is no way."""
        space = self.space
        begins, ends = space.at_ease(pose.position), space.at_ease(target)
        # A path between two such places proves that there is a way, and costs less than to flood the cells for one.
        if begins and ends:
            path = self.route(pose.position, target)
            if path is not None:
                return path
        if not space.joined(pose.position, target):
            return None
        goal = None if ends else space.near(target, self._arrival_radius)
        if begins and goal is not None:
            path = self.route(pose.position, goal)
            if path is not None:
                return path
        return space.way(pose.position, target)
