"""The directions of imports (docs/architecture.md): common knows nobody, the others know common alone."""

import ast
import functools
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("common", "actors", "learner", "deploy", "hdplanner")
ALLOWED = {
    "common": set(),
    "actors": {"common"},
    "learner": {"common"},
    "deploy": {"common"},
    # The front door knows the rooms; no room knows the door.
    "hdplanner": {"common", "actors"},
}
# Two places put parts together; nothing else may.
MEETING_PLACES = {"learner/serial.py": {"actors"}, "deploy/robot": {"actors"}}
ONLY_IN = {"pybullet": "actors", "trustme": "learner", "tensorboard": "learner", "gymnasium": "hdplanner"}

MODULES = sorted(path for name in PACKAGES for path in (ROOT / name).rglob("*.py"))


@functools.cache
def trees() -> list[tuple[Path, list[ast.AST]]]:
    """Return each module, by its path from the root, with all nodes of its syntax."""
    return [(path.relative_to(ROOT), list(ast.walk(ast.parse(path.read_text("utf-8"))))) for path in MODULES]


def imported(nodes: list[ast.AST]) -> set[str]:
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


def test_imports_run_one_way():
    for module, nodes in trees():
        package = module.parts[0]
        meeting = {name for place, names in MEETING_PLACES.items() if module.is_relative_to(place) for name in names}
        allowed = {package, *ALLOWED[package], *meeting}
        for name in imported(nodes):
            top = name.split(".")[0]
            assert top not in PACKAGES or top in allowed, f"{module} imports {name}"
            assert ONLY_IN.get(top, package) == package, f"{module} imports {name}"
            assert top != "pickle", f"{module} imports pickle"
            assert package != "common" or name != "torch.optim", f"{module} imports an optimiser"


def test_rooms_of_a_package_import_one_way():
    """A room is a folder or a module of a package; two that import each other are one, or want a third below both."""
    uses: dict[str, set[str]] = {}
    for module, nodes in trees():
        package, room = module.parts[0], ".".join(module.with_suffix("").parts[:2])
        used = {".".join(name.split(".")[:2]) for name in imported(nodes) if name.startswith(f"{package}.")}
        uses.setdefault(room, set()).update(used - {room})
    try:
        TopologicalSorter(uses).prepare()
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


def test_nothing_compares_the_names_of_tasks():
    """What differs between tasks is said by `common.tasks.Task`, so that a new one is one object and no search."""
    for module, nodes in trees():
        for node in nodes:
            if isinstance(node, ast.Compare):
                constants = {each.value for each in ast.walk(node) if isinstance(each, ast.Constant)}
                # The generator `rooms` has two styles of that name.
                if constants & {"exploration", "navigation"}:
                    assert module.as_posix() == "actors/maps/generators/rooms.py", f"{module}: {ast.unparse(node)}"
