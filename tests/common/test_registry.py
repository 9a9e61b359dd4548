"""Names of what ships, of what packages add, and of what lies in the user's own folder."""

import sys

import pytest

from common.errors import ConfigError, MapError
from common.extensions import GENERATORS, SIMULATORS
from common.planners.registry import PLANNERS
from common.registry import Entry, NamedPart, Registry, is_module_path, refuse_modules
from common.tasks import TASKS
from tests.plugins import install

MINE = """
'''A module of a stranger.'''
class Mine:
    '''Goes where it likes.

    And more.'''
class Other:
    summary = "goes elsewhere"
    class Inner: ...
"""


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder of installed packages; what was imported from it is forgotten afterwards."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    before = set(sys.modules)
    yield folder
    for name in set(sys.modules) - before:
        del sys.modules[name]


@pytest.fixture
def registry():
    return Registry("planner", "hdplanner.planners", {"tour": Entry("common.tours.cover:plan_cover", "a tour")})


@pytest.mark.parametrize("registry", [PLANNERS, SIMULATORS, TASKS, GENERATORS], ids=lambda each: each.word)
def test_everything_that_ships_can_be_loaded_and_has_a_summary(registry):
    for name in registry.shipped:
        if (registry.word, name) not in {("simulator", "pybullet"), ("planner", "bit_star")}:
            assert registry.load(name) is not None
        assert registry.summary(name)


def test_an_installed_package_adds_a_name(site, registry):
    install(
        site,
        "stranger",
        "[hdplanner.planners]\nmine = stranger_planner:Mine\nother = stranger_planner:Other\n",
        stranger_planner=MINE,
    )
    assert registry.names() == ["tour", "mine", "other"]
    assert registry.load("mine").__name__ == "Mine"
    assert registry.summary("mine") == "Goes where it likes."
    assert registry.summary("other") == "goes elsewhere"
    assert "mine" not in SIMULATORS.names()


def test_what_ships_cannot_be_replaced_and_two_packages_cannot_share_a_name(site, registry, caplog):
    install(site, "first", "[hdplanner.planners]\ntour = stranger_planner:Mine\n", stranger_planner=MINE)
    assert registry.load("tour").__module__ == "common.tours.cover"
    assert registry.names() == ["tour"]
    assert "first" in caplog.text
    install(site, "second", "[hdplanner.planners]\nmine = stranger_planner:Mine\n")
    install(site, "third", "[hdplanner.planners]\nmine = stranger_planner:Other\n")
    with pytest.raises(ConfigError, match=r"packages \w+ and \w+ both add the planner 'mine'"):
        registry.load("mine")


def test_a_module_of_the_current_folder_is_found_but_never_instead_of_ours(tmp_path, monkeypatch, site, registry):
    folder = tmp_path / "work"
    (folder / "common").mkdir(parents=True)
    (folder / "common" / "__init__.py").write_text("raise RuntimeError('foreign code')")
    (folder / "my_planner.py").write_text(MINE)
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert registry.load("my_planner:Mine").__name__ == "Mine"
    assert registry.load("my_planner:Other.Inner").__name__ == "Inner"
    assert sys.path[-1] == str(folder)


def test_errors_list_what_exists_and_how_to_name_ones_own(tmp_path, monkeypatch, site, registry):
    monkeypatch.setattr(sys, "path", list(sys.path))
    with pytest.raises(
        ConfigError, match=r"no planner 'tuor' \(did you mean 'tour'\?\); planners are: tour, or MODULE"
    ):
        registry.load("tuor")
    with pytest.raises(ConfigError, match="expected MODULE:CLASS, such as my_package.my_module:MyPlanner"):
        registry.load("my planner.py:Mine")
    with pytest.raises(ConfigError, match="cannot load planner 'nowhere:Mine': No module named 'nowhere'"):
        registry.load("nowhere:Mine")
    install(site, "broken", "[hdplanner.planners]\nbroken = broken_planner:Mine\n", broken_planner="1 / 0")
    with pytest.raises(
        ConfigError, match="cannot load planner 'broken': importing module broken_planner fails with Zero"
    ):
        registry.load("broken")
    with pytest.raises(ConfigError, match="has no attribute 'Nobody'"):
        registry.load("common.registry:Nobody")
    with pytest.raises(MapError, match="no generator 'ofice'"):
        GENERATORS.check("ofice")


def test_checking_a_name_imports_nothing(site, registry):
    install(site, "broken", "[hdplanner.planners]\nbroken = broken_planner:Mine\n", broken_planner="1 / 0")
    registry.check("broken")
    registry.check("broken_planner:Mine")
    assert "broken_planner" not in sys.modules


@pytest.mark.parametrize(
    ("name", "is_one"),
    [
        ("a:B", True),
        ("a.b_c:D.e", True),
        ("tour", False),
        ("a:b:c", False),
        ("a/b:C", False),
        (":C", False),
        ("a:", False),
        ("a:B\n", False),
    ],
)
def test_what_a_module_path_is(name, is_one):
    assert is_module_path(name) == is_one


def test_names_of_others_are_refused_unless_the_user_gave_them(registry):
    parts = [NamedPart("task.name", registry, "tour"), NamedPart("simulator.name", registry, "theirs:Code")]
    refuse_modules(parts, {"theirs:Code"}, "a message", "allow it")
    refuse_modules(parts[:1], (), "a message", "allow it")
    # Whatever has a colon is refused, also what no import could find.
    for name in ("theirs:Code", "theirs:", "their s:Code"):
        with pytest.raises(ConfigError, match=r"a message names the planner .* \(x\), which is code.*: allow it"):
            refuse_modules([NamedPart("x", registry, name)], {"mine:Code"}, "a message", "allow it")
