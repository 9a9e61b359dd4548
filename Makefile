# Two commands on a fresh machine do everything: make run, make test.
SHELL := /bin/bash
# The first of these that is there; 3.11 has everything, newer ones have no PyBullet.
PYTHON ?= $(firstword $(foreach name,python3.11 python3.12 python3.13,$(if $(shell command -v $(name)),$(name))) python3.11)
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# The programs' own packages are there: what kernels are compiled with.
PACKAGES := $(VENV)/.packages
# Real ROS 2 as wheels, in an environment beside the other one.
ROS_VENV := .venv-ros
ROS_STAMP := $(ROS_VENV)/.installed
JOBS ?= 2
MINUTES ?= 30
JSON ?= build/bench.json
# Children that a test starts, and the processes of a parallel run, read what one has translated.
unexport PYTHONDONTWRITEBYTECODE
# A file's tests stay in one process, so that what they share is made once; in the order of tests/conftest.py.
PARALLEL := -n $(JOBS) --dist loadfile --no-loadscope-reorder --durations 12

.DEFAULT_GOAL := help
.PHONY: help install kernels run demo check test test-twice test-all test-page ros-environment test-ros lint types format docs bench bench-compare paper soak faults fuzz clean

help:  ## show the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-10s %s\n", $$1, $$2}'

PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

# The pip that CPython 3.11 brings along takes twice as long for what follows.
$(BIN)/pip:
	$(PYTHON) -m venv $(VENV)
	@$(PIP_INSTALL) --upgrade pip || echo 'pip could not be updated: installing takes longer'

# In two parts: while the second one is downloaded and unpacked, kernels can be compiled.
$(PACKAGES): pyproject.toml constraints.txt | $(BIN)/pip
	$(PIP_INSTALL) torch
	$(PIP_INSTALL) -e '.[actor,learner,planners,robot]'
	touch $@

# Not `-e` again, which would take the project away for a moment. Bytecode of what processes import, and not of all
# 240 MB of packages.
$(STAMP): $(PACKAGES)
	$(PIP_INSTALL) 'hdplanner[dev]'
	$(BIN)/python -c 'import actors.evaluation.worker, deploy.bridge.bridge, learner.process'
	@$(BIN)/python -c 'import pybullet' 2>/dev/null || echo 'no PyBullet here (it has no wheels from Python 3.12 on): use --sim grid'
	touch $@

install: $(STAMP)  ## create .venv and install everything into it

kernels: $(PACKAGES)  ## compile once, in two processes, what actors, learners, planners and robots call
	$(BIN)/python scripts/compile_kernels.py

run: $(STAMP)  ## train here: a learner, two PyBullet actors and an evaluator, with a live view (Ctrl-C stops; run again to resume)
	@sim=''; $(BIN)/python -c 'import pybullet' 2>/dev/null || { sim='--sim grid'; echo 'no PyBullet here: training with --sim grid'; }; \
	if compgen -G 'runs/default/checkpoints/*' >/dev/null; then $(BIN)/hd-learner resume --actors 2 --evaluators 1 $$sim; \
	else $(BIN)/hd-learner start --preset workstation --actors 2 --evaluators 1 $$sim; fi

demo: $(STAMP)  ## a simulated robot explores an office, live in the terminal; writes a video to runs/demo
	$(BIN)/hd-deploy demo

test: $(STAMP)  ## the test suite without its slow tests
	$(BIN)/python -m pytest $(PARALLEL) -m 'not slow'

# Only after a whole run with failures (exit code 1) and only for what failed; a fault fails twice.
test-twice: $(STAMP)  ## the same, and what failed once more, alone
	@rm -rf .pytest_cache; status=0; \
	$(BIN)/python -m pytest $(PARALLEL) -m 'not slow' || status=$$?; \
	[ $$status = 1 ] || exit $$status; \
	echo '===== these tests failed beside others; now each of them alone: a fault fails twice ====='; \
	$(BIN)/python -m pytest -n 0 -m 'not slow' --last-failed --last-failed-no-failures none --maxfail 5 || \
		{ echo '===== failed twice ====='; exit 1; }; \
	echo '===== passed alone: a test that needs a quiet machine, to be mended ====='

check:  ## everything that must pass before a change lands: install, lint, types, tests
	bash .ci/run

test-all: $(STAMP)  ## the whole test suite, but for the tests that need a browser
	$(BIN)/python -m pytest $(PARALLEL) --hypothesis-profile=thorough -m 'not page'

test-page: $(STAMP)  ## the pages in headless Chromium (apt-get install chromium): a simulated robot and a training, real processes
	$(BIN)/python -m pytest -n 0 -m page

ros-environment: | $(BIN)/pip
	@if [ $(ROS_STAMP) -ot pyproject.toml ] || [ $(ROS_STAMP) -ot constraints.txt ]; then \
		status=0; scripts/ros_environment.sh $(PYTHON) $(VENV) $(ROS_VENV) || status=$$?; \
		if [ "$$status" = 3 ]; then rm -rf $(ROS_VENV); exit 0; fi; \
		[ "$$status" = 0 ] && touch $(ROS_STAMP); \
	fi

test-ros: $(STAMP) ros-environment  ## the relay against real ROS 2 (rclpy, Fast DDS); skipped with a message where there are no wheels
	@if [ -e $(ROS_STAMP) ]; then $(ROS_VENV)/bin/python -m pytest $(PARALLEL) -m 'not slow' tests/deploy/relay; \
	else echo "test-ros: SKIPPED, the package registry has no ROS 2 for this Python and platform"; fi

lint: $(STAMP)  ## style, format, spelling, docstrings against signatures
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/python scripts/check_docstrings.py common actors learner deploy hdplanner benchmarks scripts examples

types: $(STAMP)  ## static types
	$(BIN)/mypy

format: $(STAMP)  ## put the code into its format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(STAMP)  ## write the generated pages, and build the site in build/site
	$(BIN)/python -c "from pathlib import Path; from common.config.describe import documentation; Path('docs/configuration.md').write_text(documentation(), 'utf-8')"
	$(BIN)/python -c "from pathlib import Path; from deploy.profiles import documentation; Path('docs/deploy/parameters.md').write_text(documentation(), 'utf-8')"
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict

bench: $(STAMP)  ## measure: decision step, simulators, inference, actors, updates, ingest, memory; all in JSON=build/bench.json
	$(BIN)/python -m benchmarks --json $(JSON)

bench-compare: $(STAMP)  ## what changed between two files of `make bench`: A=OLD.json B=NEW.json
	@[ -n "$(A)" ] && [ -n "$(B)" ] || { echo 'expected two files: make bench-compare A=OLD.json B=NEW.json'; exit 2; }
	$(BIN)/python -m benchmarks.compare $(A) $(B)

paper: $(STAMP)  ## the paper's tables with all trainings behind them, in docs/paper.md and release/paper: MAPS=FOLDER (docs/paper.md)
	@[ -n "$(MAPS)" ] || { echo 'expected the folder of the public maps: make paper MAPS=FOLDER'; exit 2; }
	$(BIN)/python -m benchmarks.paper --maps $(MAPS)

soak: $(STAMP)  ## half an hour of physics with a fault every minute: a table of each stop (MINUTES=30)
	$(BIN)/python -m benchmarks.soak --minutes $(MINUTES)

faults: $(STAMP)  ## inject faults into a training run (kill, freeze, cut, fill, damage, flood): a table of losses (docs/faults.md)
	$(BIN)/python -m benchmarks.faults

fuzz: $(STAMP)  ## fuzz all decoders with modified bytes (MINUTES=30)
	$(BIN)/python -m tests.fuzz --minutes $(MINUTES)

clean:  ## remove caches and the environment, never runs/
	rm -rf $(VENV) $(ROS_VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis build *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
