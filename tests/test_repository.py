"""Files around the code: workflows, containers and citation name what is really there."""

import re
import tomllib
from pathlib import Path

import pytest

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
DOCKERFILE = (ROOT / "Dockerfile").read_text("utf-8")
COMPOSE = yaml.safe_load((ROOT / "compose.yaml").read_text("utf-8"))
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def test_the_image_copies_what_there_is_and_installs_extras_that_exist():
    for line in re.findall(r"^COPY (.*)", DOCKERFILE, re.M):
        for source in line.split()[:-1]:
            assert (ROOT / source).exists(), source
    ignored = (ROOT / ".dockerignore").read_text("utf-8").splitlines()
    packages = {path.parent.name for path in ROOT.glob("*/py.typed")}
    assert packages <= {line.removeprefix("!") for line in ignored if line.startswith("!")}
    for extras in re.findall(r"'\.\[([\w,]+)\]'", DOCKERFILE):
        assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])


def test_services_build_targets_of_the_dockerfile_and_run_our_commands():
    targets = set(re.findall(r"^FROM \S+ AS (\w+)", DOCKERFILE, re.M))
    for name, service in COMPOSE["services"].items():
        assert service["build"]["target"] in targets, name
        assert set(service.get("depends_on", [])) <= set(COMPOSE["services"]), name
        assert service.get("command", ["hd-learner"])[0] in PROJECT["scripts"], name
    for command in re.findall(r'^CMD \["([^"]+)"', DOCKERFILE, re.M):
        assert command in PROJECT["scripts"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_use_targets_tests_and_extras_that_exist(path):
    jobs = yaml.safe_load(path.read_text("utf-8"))["jobs"]
    makefile = (ROOT / "Makefile").read_text("utf-8")
    steps = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    assert steps
    for run in steps:
        for target in re.findall(r"^make (\S+)", run, re.M):
            assert re.search(rf"^{target}:", makefile, re.M), target
        for test in re.findall(r"\btests/\S+", run):
            assert (ROOT / test).exists(), test
        for extras in re.findall(r"\[([a-z0-9,]+)\]", run):
            assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"]), extras


def test_the_citation_is_of_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
