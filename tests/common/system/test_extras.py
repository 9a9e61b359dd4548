"""What a user sees where an optional package is missing."""

import importlib
import json
import os
import subprocess
import sys
from importlib.metadata import PackageNotFoundError

import pytest

from common.system.extras import MissingPackageError, extras_with, install_command, optional

# All that the extras bring, by the names under which they are imported.
OPTIONAL = [
    "PIL",
    "psutil",
    "yaml",
    "torch",
    "pybullet",
    "tensorboard",
    "trustme",
    "ompl",
    "ortools",
    "rosbags",
    "shapely",
    "xxhash",
    "onnx",
    "onnxruntime",
    "pyoctomap",
    "mcap",
    "mcap_ros2",
    "zstandard",
    "rerun",
    "imageio",
    "imageio_ffmpeg",
    "matplotlib",
    "scipy",
    "mlflow",
    "wandb",
]
COMMANDS = [
    (["deploy.cli", "record", "--out", "bag"], "mcap", "recording"),
    (["deploy.cli", "topics"], "xxhash", "robot"),
    (["deploy.cli", "robot"], "xxhash", "actor,pybullet,robot,plots"),
    (["learner.cli", "start", "--run", "here"], "torch", "learner"),
    (["learner.cli", "plot"], "matplotlib", "plots"),
    (["actors.evaluation.cli", "video", "x.json", "--maps", "generator:office", "--out", "x.gif"], "pillow", "actor"),
]
# Commands one after the other in a process where no extra is installed.
BARE = f"""
import contextlib, importlib, io, json, sys
for name in {OPTIONAL!r}:
    sys.modules[name] = None
for module, *arguments in json.loads(sys.argv[1]):
    sys.argv = [module, *arguments]
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        try:
            importlib.import_module(module).app()
            status = 0
        except SystemExit as end:
            status = end.code or 0
    print(json.dumps([status, out.getvalue(), err.getvalue()]))
"""


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """What the commands and the list of planners told, as (status, output, errors), and the folder they ran in."""
    folder = tmp_path_factory.mktemp("bare")
    commands = [["actors.evaluation.cli", "planners"], *(command for command, _, _ in COMMANDS)]
    done = subprocess.run(
        [sys.executable, "-c", BARE, json.dumps(commands)],
        capture_output=True,
        text=True,
        env=os.environ | {"HD_PROCESS_PREPARED": "1", "COLUMNS": "100"},
        cwd=folder,
        timeout=110,
    )
    assert done.returncode == 0, done.stderr
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(told) == len(commands)
    return told, folder


def test_planners_are_listed_without_any_extra(bare):
    status, output, errors = bare[0][0]
    assert status == 0, errors
    assert "nearest" in output


@pytest.mark.parametrize(
    ("place", "package", "extra"),
    [
        pytest.param(place, package, extra, id=" ".join(command))
        for place, (command, package, extra) in enumerate(COMMANDS, 1)
    ],
)
def test_a_missing_package_is_one_sentence_with_what_to_install(bare, place, package, extra):
    status, _, errors = bare[0][place]
    assert status == 1
    assert "Traceback" not in errors
    assert f"needs the package {package}, which is not installed" in errors
    assert f"[{extra}]'" in errors
    assert list(bare[1].iterdir()) == []


def test_the_gymnasium_environment_says_which_extra_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "hdplanner.gym", raising=False)
    with pytest.raises(MissingPackageError, match=r"hdplanner\.gym needs the package gymnasium, .*\[gym\]'"):
        importlib.import_module("hdplanner.gym")


def test_a_missing_module_of_our_own_is_a_defect():
    with pytest.raises(ModuleNotFoundError) as caught, optional("this"):
        import common.no_such_module  # noqa: F401
    assert not isinstance(caught.value, MissingPackageError)


class Installed:
    """Metadata of an installation."""

    requires = ("numpy>=1", 'torch>=2; extra == "actor"', 'torch>=2; extra == "learner"', 'torch>=2; extra == "all"')

    def __init__(self, origin: object) -> None:
        self.origin = origin

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return None if self.origin is None else json.dumps(self.origin)


def test_the_extra_is_found_in_the_metadata_and_a_wanted_one_comes_first(monkeypatch):
    monkeypatch.setattr("importlib.metadata.distribution", lambda name: Installed(None))
    assert extras_with("torch") == ("actor", "learner")
    assert extras_with("torch", "learner") == ("learner", "actor")
    assert extras_with("numpy") == ()


def test_the_command_names_the_checkout_or_the_wheel(monkeypatch, tmp_path):
    wheel = tmp_path / "hdplanner-1.0-py3-none-any.whl"
    wheel.touch()
    editable = {"url": tmp_path.as_uri(), "dir_info": {"editable": True}}
    for origin, words in (
        (editable, f"install -e '{tmp_path}[robot,plots]'"),
        ({"url": wheel.as_uri(), "archive_info": {}}, f"install '{wheel}[robot,plots]'"),
        ({"url": (tmp_path / "gone.whl").as_uri()}, "'.[robot,plots]' in the checkout (or 'FILE.whl[robot,plots]'"),
        (None, "'.[robot,plots]' in the checkout"),
    ):
        monkeypatch.setattr("importlib.metadata.distribution", lambda name, origin=origin: Installed(origin))
        assert words in install_command("robot", "plots")


def test_without_metadata_the_command_still_says_what_to_do(monkeypatch):
    def missing(name: str) -> Installed:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.distribution", missing)
    assert "'.[robot]' in the checkout" in install_command("robot")


def test_newer_pythons_hear_that_pybullet_has_no_wheel(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 12, 1))
    sentence = str(MissingPackageError("the simulator", "pybullet", ("pybullet",), "use --sim grid"))
    assert sentence == (
        "the simulator needs the package pybullet, which has no ready-made wheel for Python 3.12: use Python 3.11, or "
        "use --sim grid"
    )
