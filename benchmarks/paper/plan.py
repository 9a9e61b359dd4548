"""What the paper's tables are made of: trainings, tables with their rows, and the order of the work.

J. Liang, Y. Cao, Y. Ma, H. Zhao, G. Sartoretti: "HDPlanner: Advancing Autonomous Deployments in Unknown Environments
through Hierarchical Decision Networks", IEEE Robotics and Automation Letters, 2025.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

SEEDS: Final = (0, 1, 2)
"""Of every training."""
UPDATES: Final = 3_000
"""Of every training, imitation included; all variants and baselines have the same number."""
IMITATION: Final = 1_200
"""How many of them imitate the privileged expert, where a variant does."""
MAPS: Final = "{maps}"
"""Stands for the folder of the public maps in options."""
SCENES: Final = "{scenes}"
"""Stands for the folder of the scenes that `scenes` makes."""

Task = Literal["exploration", "navigation"]


@dataclass(frozen=True, slots=True)
class Training:
    """A policy to be trained, once for each seed.

    Attributes:
        name: of the variant or baseline, with its task: unique.
        label: what tables call it.
        task: exploration or navigation.
        preset: of `hd-learner start`.
        settings: ``SECTION.FIELD=VALUE`` beyond the preset and the budget.
    """

    name: str
    label: str
    task: Task
    preset: str
    settings: tuple[str, ...] = ()

    def options(self, seed: int) -> list[str]:
        """Return the options of `hd-learner start` that say what is learned, with ``{maps}`` in them."""
        maps = f"{MAPS}/{self.task}/train"
        generator = "generator:rooms" if self.task == "exploration" else "generator:rooms?style=navigation"
        settings = (
            f"maps.train={maps}#train,{generator}",
            f"maps.validation={maps}#validation",
            f"seed={seed}",
            f"learner.total_updates={UPDATES}",
            "learner.threads=1",
            *self.settings,
        )
        return ["--preset", self.preset, *(part for setting in settings for part in ("--set", setting))]


def _imitating(label: str, task: Task, setting: str) -> Training:
    """Return the training of a variant that imitates the privileged expert first."""
    recipe = (f"cloning.updates={IMITATION}", "sac.critic_only_updates=100")
    return Training(f"{label}-{task}", label, task, task, (setting, *recipe))


_TASKS: Final[tuple[Task, ...]] = ("exploration", "navigation")
_VARIANTS: Final = ("hdplanner", "hierarchical", "vanilla")

TRAININGS: Final = (
    *(_imitating(name, task, f"network.variant={name}") for task in _TASKS for name in _VARIANTS),
    _imitating("paper-features", "exploration", "network.features=paper"),
    _imitating("full-graph", "exploration", "network.graph=full"),
    Training("cnn-exploration", "cnn", "exploration", "cnn"),
    Training("ca-navigation", "ca", "navigation", "ca"),
    Training("ariadne-exploration", "ariadne", "exploration", "ariadne"),
)
"""`paper-features` and `full-graph` are hdplanner without what this project added to the paper's inputs. The baselines
learn as published, without imitation (docs/baselines.md)."""


@dataclass(frozen=True, slots=True)
class Row:
    """A planner in a table.

    Attributes:
        label: what the table calls it.
        planner: of `hd-eval` or `hd-deploy`.
        training: name of the training whose policy it takes, with `seed`; None for what needs none.
        seed: of the training.
    """

    label: str
    planner: str
    training: str | None = None
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the paper, or the part of one that has the same worlds.

    Attributes:
        name: of its folder.
        title: what the page calls it.
        kind: what makes a row: `hd-eval run`, `hd-eval large` or `hd-deploy demo`.
        options: of that command, with ``{maps}`` in them.
        baseline: label that ratios are taken to.
        rows: in the order of the work.
    """

    name: str
    title: str
    kind: Literal["run", "large", "demo"]
    options: tuple[str, ...]
    baseline: str
    rows: tuple[Row, ...]


def _plain(*planners: str) -> tuple[Row, ...]:
    return tuple(Row(name, name) for name in planners)


def _learned(task: Task, *labels: str) -> tuple[Row, ...]:
    """Return a row for each seed of the trainings of a task; of those named, or of all."""
    return tuple(
        Row(f"{training.label}-{seed}", "hdplanner", training.name, seed)
        for seed in SEEDS
        for training in TRAININGS
        if training.task == task and (not labels or training.label in labels)
    )


SHIPPED: Final = Row("shipped", "hdplanner")
"""The policy in the package, with its guard; trained for longer than the others of the tables."""

LARGE_STARTS: Final = 5
"""Start places in the paper's large scene: the public one and others, far apart."""

_LARGE = ("--world", f"{SCENES}/large", "--seeds", str(LARGE_STARTS), "--robot-radius", "0.25")
_HARDWARE = ("--video", "", "--page", "", "--set", "mapping.resolution=0.2", "--set", "driving.max_speed=1.0")

TABLES: Final = (
    Table(
        "exploration",
        "Exploration, 300 public maps",
        "run",
        ("--maps", f"{MAPS}/exploration/bench"),
        "tare",
        (*_plain("omniscient", "tare", "greedy", "dsvp", "nearest", "nbvp"), SHIPPED, *_learned("exploration")),
    ),
    Table(
        "navigation",
        "Navigation, 100 public maps",
        "run",
        ("--task", "navigation", "--maps", f"{MAPS}/navigation/bench"),
        "dstar_lite",
        (*_plain("omniscient", "dstar_lite", "astar", "far", "bit_star"), SHIPPED, *_learned("navigation")),
    ),
    Table(
        "large-exploration",
        f"The large scene under physics, exploration from {LARGE_STARTS} start places",
        "large",
        _LARGE,
        "tare",
        (
            *_plain("dsvp", "tare", "nearest", "tour"),
            SHIPPED,
            *_learned("exploration", "hierarchical", "hdplanner", "ariadne"),
        ),
    ),
    Table(
        "large-navigation",
        f"The large scene under physics, tours of 5 targets from {LARGE_STARTS} start places",
        "large",
        ("--task", "navigation", "--targets", "5", *_LARGE),
        "dstar_lite",
        (*_plain("dstar_lite", "far"), SHIPPED, *_learned("navigation", "hierarchical", "hdplanner")),
    ),
    *(
        Table(
            scene,
            f"The simulated robot over the bus: {scene}",
            "demo",
            ("--map", f"{SCENES}/{scene}", *_HARDWARE),
            "tare",
            (*_plain("tare", "nearest"), SHIPPED),
        )
        for scene in ("laboratory", "garden")
    ),
)
"""In the order of the work: what needs no training comes first in each of them."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a row stands: its table and itself."""

    table: Table
    row: Row


def work() -> Iterator[tuple[tuple[Training, int] | None, list[Place]]]:
    """Yield what is to be done: each training with its seed, and the rows that need it.

    First come the rows without any, then the first seed of all trainings, then one training after the other its further
    seeds: those of the paper's own variants and of their inputs before those of the baselines.
    """
    places = [Place(table, row) for table in TABLES for row in table.rows]
    yield from ((None, [place]) for place in places if place.row.training is None)
    first = [(training, SEEDS[0]) for training in TRAININGS]
    further = [(training, seed) for training in TRAININGS for seed in SEEDS[1:]]
    for training, seed in first + further:
        needs = (training.name, seed)
        yield (training, seed), [place for place in places if (place.row.training, place.row.seed) == needs]
