"""A Gymnasium environment: the planning problem of the paper for any learner of one's own. Needs the extra `gym`.

::

    env = gymnasium.make("hdplanner.gym:HDPlanner-v0", settings=["maps.train=generator:office"])
    observation, info = env.reset(seed=1)
    action = env.action_space.sample(info["action_mask"])
    observation, reward, terminated, truncated, info = env.step(action)

**Action**: ``(beacon, waypoint)``, two node numbers. The robot drives to the waypoint, a neighbour of its node; the
beacon is the area on behalf of which it goes there, and changes nothing in the world. ``info["action_mask"]`` holds a
mask for each, int8, shape (N,), in the form that ``action_space.sample`` takes; the observation holds both as well. An
action that the masks forbid moves nothing, costs `invalid_cost`, and counts as a decision.

**Observation**: a dictionary of arrays of one size, padded to N = ``max_viewpoints + 1`` nodes and E = ``max_edges``
edges. A node keeps its number for one step only: the graph grows and is numbered anew.

- ``nodes``: float32, shape (N, 6): x and y from the robot (metres), utility (observable frontier cells), and 1 or 0 for
  visited, beacon and target; zeros beyond ``count``.
- ``edges``: int32, shape (E, 2), each edge once; -1 beyond the last one.
- ``count``: number of nodes; ``robot``: the robot's node.
- ``beacon_mask``, ``waypoint_mask``: int8, shape (N,).

**Reward** and **end** are those of the run's configuration (`reward`, `task`): terminated when the task is complete or
cannot be completed, truncated at the limit of decisions.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.arena import Arena, Stage
from actors.collector import MAX_BAD_MAPS
from actors.evaluation.plots import belief_picture
from actors.simulators.factory import make_simulator
from actors.step import Step
from common.config import RunConfig
from common.config.load import load_config
from common.errors import ConfigError, HDError, MapError
from common.messages.experience import End
from common.observations.observation import Observation
from common.system.extras import optional

with optional("hdplanner.gym", "gym"):
    import gymnasium
    from gymnasium import spaces

FEATURES = 6
# Bounds of a node's features: far beyond any building, and the most that a utility can be.
_FARTHEST = 1.0e5
_MOST_FRONTIERS = 65_535.0

Arrays = dict[str, Any]


class PlanningEnv(gymnasium.Env[Arrays, NDArray[np.int64]]):
    """One robot in one world at a time; see the text of the module."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012 - Gymnasium's own form
    _observation: Observation

    def __init__(
        self,
        settings: Sequence[str] = (),
        *,
        config: RunConfig | None = None,
        max_viewpoints: int = 512,
        max_edges: int | None = None,
        invalid_cost: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        """Make the simulator and open the worlds.

        Args:
            settings: changes of a run's settings, ``section.field=value``: worlds, task, mapping, reward and the like;
                the simulator is `grid` unless they say otherwise.
            config: the whole configuration, in place of `settings`.
            max_viewpoints: that an observation has room for.
            max_edges: likewise; 12 for each viewpoint when not given.
            invalid_cost: subtracted for an action that the masks forbid.
            render_mode: `rgb_array`: `render` returns the belief with the robot's way, a pixel a cell of the map.

        Raises:
            ConfigError: a setting is unknown or out of range, or both settings and a configuration are given.
            MapError: a source of worlds cannot be used.
            SimulatorError: the simulator cannot be made.
        """
        if config is not None and settings:
            raise ConfigError("give settings or a configuration, not both")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(f"render_mode must be 'rgb_array' or None, got {render_mode!r}")
        self.config = config or load_config(overrides=["simulator.name=grid", *settings])
        self.render_mode = render_mode
        self._invalid_cost = invalid_cost
        if max_viewpoints < 1 or (max_edges is not None and max_edges < 1):
            raise ConfigError(f"room is for at least one viewpoint and edge, got {max_viewpoints} and {max_edges}")
        self._nodes = max_viewpoints + 1
        self._edges = 12 * max_viewpoints if max_edges is None else max_edges
        self._simulator = make_simulator(self.config.simulator, self.config.mapping.sensor_range)
        self._arenas = [
            Arena(self.config, task, family, number, self._simulator, evaluate=False)
            for number, family in enumerate(self.config.mix)
            for task in self.config.tasks
            if family.serves(task.name)
        ]
        shares = np.array([arena.share for arena in self._arenas])
        self._shares = shares / shares.sum()
        self._stage: Stage | None = None
        self._decisions = self._limit = 0
        self.observation_space = _observation_space(self._nodes, self._edges)
        self.action_space = spaces.MultiDiscrete([self._nodes, self._nodes])

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Arrays, dict[str, Any]]:
        """Begin an episode in a random world; equal seeds give equal episodes.

        Args:
            seed: of worlds and simulator.
            options: ``{"world": 3}`` begins in world number 3 of the first family's sources.

        Raises:
            ConfigError: an option is unknown, or its value is no number of a world.
            HDError: no world of the source can be used, or the graph has more viewpoints or edges than there is room.
        """
        super().reset(seed=seed)
        number = _world_number(options or {})
        for _ in range(MAX_BAD_MAPS if number is None else 1):
            try:
                if self._begin(number):
                    return self._told(invalid=False)
                reason: object = "the episode ended where it began"
            except MapError as error:
                reason = error
        raise HDError(f"no world of {self._arenas[0].source.name} can be used; the last reason: {reason}")

    def step(self, action: NDArray[np.int64]) -> tuple[Arrays, float, bool, bool, dict[str, Any]]:
        """Drive to a waypoint on behalf of a beacon.

        Args:
            action: (beacon, waypoint), node numbers.

        Returns:
            Observation, reward, terminated, truncated, info.

        Raises:
            ConfigError: the action is no pair of whole numbers.
            HDError: the episode has ended or never began, or the graph has outgrown the observation.
        """
        if self._stage is None or self._stage.environment.end is not End.NONE or self._decisions >= self._limit:
            raise HDError("the episode has ended or never began: call reset() first")
        environment = self._stage.environment
        beacon, waypoint = _pair(action)
        self._decisions += 1
        valid = beacon in self._observation.beacon_nodes() and waypoint in self._observation.waypoint_nodes()
        reward = -self._invalid_cost
        if valid:
            step: Step = environment.step(beacon, waypoint)
            self._observation = step.observation
            reward = step.reward
        observation, info = self._told(invalid=not valid)
        terminated = environment.end is End.TERMINAL
        truncated = not terminated and (environment.end is End.TRUNCATED or self._decisions >= self._limit)
        return observation, float(reward), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return the belief with the way so far in red, uint8, shape (rows, columns, 3); None without a render mode."""
        if self.render_mode is None or self._stage is None:
            return None
        environment = self._stage.environment
        picture = belief_picture(environment.mapper.belief, environment.world)
        for (x, y), (u, v) in pairwise([*environment.positions, environment.pose.position]):
            for share in np.linspace(0.0, 1.0, 64):
                row, column = environment.world.cell((x + share * (u - x), y + share * (v - y)))
                picture[-1 - row, column] = (179, 38, 30)
        return picture

    def close(self) -> None:
        """Release the simulator; safe to call twice."""
        self._simulator.close()

    def _begin(self, number: int | None) -> bool:
        """Begin an episode; return whether there is anything to decide in it."""
        if number is None:
            arena = self._arenas[int(self.np_random.choice(len(self._arenas), p=self._shares))]
            self._stage, seed = arena.draw(self.np_random), int(self.np_random.integers(2**31))
        else:
            self._stage, seed = self._arenas[0].fixed(number), number
        environment = self._stage.environment
        self._observation = environment.reset(self._stage.world, seed)
        self._decisions, self._limit = 0, environment.max_steps
        return environment.end is End.NONE

    def _told(self, *, invalid: bool) -> tuple[Arrays, dict[str, Any]]:
        assert self._stage is not None
        environment = self._stage.environment
        spacing = environment.mapping.viewpoint_spacing
        observation = padded(self._observation, spacing, self._nodes, self._edges)
        info = {
            "action_mask": (observation["beacon_mask"], observation["waypoint_mask"]),
            "invalid_action": invalid,
            "success": environment.success,
            "explored": environment.coverage.explored,
            "distance": environment.distance,
            "reason": environment.reason,
        }
        return observation, info


def _world_number(options: dict[str, Any]) -> int | None:
    """Return the world that the options of a reset name, None where they name none."""
    number = options.get("world")
    whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool) and number >= 0
    if options.keys() - {"world"} or not (number is None or whole):
        raise ConfigError(f"options: expected {{'world': NUMBER}} with a whole number from 0, got {options}")
    return None if number is None else int(number)


def _pair(action: Any) -> tuple[int, int]:
    """Return the two node numbers of an action."""
    nodes = np.asarray(action)
    pair = nodes.shape == (2,) and np.issubdtype(nodes.dtype, np.number)
    if not pair or not all(float(node).is_integer() for node in nodes.real):
        raise ConfigError(f"an action is (beacon, waypoint), two whole numbers of nodes, got {action!r}")
    return int(nodes[0]), int(nodes[1])


def padded(observation: Observation, spacing: float, nodes: int, edges: int) -> Arrays:
    """Return an observation as arrays of fixed sizes; see the text of the module.

    Args:
        observation: what the robot knows.
        spacing: metres to a step of the lattice.
        nodes: N.
        edges: E.

    Raises:
        ConfigError: it has more nodes or edges than there is room.
    """
    pairs = _edge_list(observation)
    if observation.nodes > nodes or len(pairs) > edges:
        raise ConfigError(
            f"the graph has {observation.nodes} nodes and {len(pairs)} edges, an observation has room for {nodes} and "
            f"{edges}: make the environment with max_viewpoints={2 * max(observation.nodes, nodes)}"
        )
    count, viewpoints = observation.nodes, observation.viewpoints
    features = np.zeros((nodes, FEATURES), dtype=np.float32)
    features[:count, :2] = spacing * observation.steps
    features[:viewpoints, 2] = observation.utility
    features[:viewpoints, 3] = observation.visited
    features[observation.beacon_nodes(), 4] = 1.0
    features[viewpoints:count, 5] = 1.0
    padded_edges = np.full((edges, 2), -1, dtype=np.int32)
    padded_edges[: len(pairs)] = pairs
    return {
        "nodes": features,
        "edges": padded_edges,
        "count": np.int64(count),
        "robot": np.int64(observation.robot),
        "beacon_mask": _mask(observation.beacon_nodes(), nodes),
        "waypoint_mask": _mask(observation.waypoint_nodes(), nodes),
    }


def _edge_list(observation: Observation) -> NDArray[np.int64]:
    """Return all edges, those of a known target too, each once, shape (m, 2)."""
    lower = np.repeat(np.arange(observation.viewpoints), observation.degree)
    pairs = np.stack([lower, observation.neighbours.astype(np.int64)], axis=1)
    links = observation.target_links.astype(np.int64)
    return np.concatenate([pairs, np.stack([links, np.full_like(links, observation.viewpoints)], axis=1)])


def _mask(chosen: NDArray[np.int64], nodes: int) -> NDArray[np.int8]:
    mask = np.zeros(nodes, dtype=np.int8)
    mask[chosen] = 1
    return mask


def _observation_space(nodes: int, edges: int) -> spaces.Dict:
    high = np.array([_FARTHEST, _FARTHEST, _MOST_FRONTIERS, 1.0, 1.0, 1.0], dtype=np.float32)
    low = np.array([-_FARTHEST, -_FARTHEST, 0.0, 0.0, 0.0, 0.0], dtype=np.float32)
    return spaces.Dict(
        {
            "nodes": spaces.Box(np.tile(low, (nodes, 1)), np.tile(high, (nodes, 1)), dtype=np.float32),
            "edges": spaces.Box(-1, nodes - 1, (edges, 2), dtype=np.int32),
            "count": spaces.Discrete(nodes + 1),
            "robot": spaces.Discrete(nodes),
            "beacon_mask": spaces.MultiBinary(nodes),
            "waypoint_mask": spaces.MultiBinary(nodes),
        }
    )


gymnasium.register(id="HDPlanner-v0", entry_point="hdplanner.gym:PlanningEnv")
