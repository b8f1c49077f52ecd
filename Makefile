# Sets up .venv from requirements-dev.lock on first use, and again only when the lock or pyproject.toml changes.
# `make PYTHON=/path/to/python3.12 …` takes another interpreter.

PYTHON ?= $(shell python3.11 -c '' 2>/dev/null && echo python3.11 || echo python3)
CONFIG ?= configs/cantilever-youngs-modulus.yaml
ARGS ?=
VENV := .venv
READY := $(VENV)/.ready
STAGES := import rom train screen observe place validate report
# A config that takes a guess from another run comes after those that do not.
CONFIGS = $(shell grep -L 'from:' configs/*.yaml) $(shell grep -l 'from:' configs/*.yaml)
# The hub of thesis 6.2; what a run has reduced already, the next ones take over. No gauge can tell input, E and ρ together
# (place refuses): observe says so.
HUB := youngs-modulus density input youngs-modulus-density input-youngs-modulus input-density \
	input-youngs-modulus-density youngs-modulus-density-better input-youngs-modulus-better
# Two test workers on two cores: more threads would only get in each other's way.
ONE_THREAD := OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

.PHONY: help run status test lint all-configs hub setup lock $(STAGES)
.DEFAULT_GOAL := help

help:
	@echo 'make run            set up, then every stage on CONFIG that is not up to date'
	@echo 'make STAGE          up to that stage: $(STAGES)'
	@echo 'make status         which stages are up to date, and why the others are not'
	@echo 'make all-configs    run on every file of configs/'
	@echo 'make hub            the hub of thesis 6.2: nine runs on configs/hub/, a page each (docs/reproduction.md)'
	@echo 'make test           set up, then all tests'
	@echo 'make lint           ruff, mypy, import-linter'
	@echo 'make lock           renew requirements-dev.lock from pyproject.toml'
	@echo
	@echo 'CONFIG=$(CONFIG)'
	@echo 'ARGS="--set place.keep=6" is passed on to strainsight'

run: $(READY)
	@$(VENV)/bin/strainsight run $(CONFIG) $(ARGS)

$(STAGES) status: $(READY)
	@$(VENV)/bin/strainsight $@ $(CONFIG) $(ARGS)

all-configs: $(READY)
	@set -e; for config in $(CONFIGS); do echo "== $$config"; $(VENV)/bin/strainsight run $$config $(ARGS); done

hub: $(READY)
	@set -e; i=0; for case in $(HUB); do i=$$((i + 1)); echo "== $$i of $(words $(HUB)): hub-$$case"; \
		case $$case in input-youngs-modulus-density) command=observe ;; *) command=run ;; esac; \
		$(VENV)/bin/strainsight $$command configs/hub/hub-$$case.yaml $(ARGS); done

test: $(READY)
	@$(ONE_THREAD) $(VENV)/bin/pytest -n 2 --dist loadfile -q $(ARGS)

lint: $(READY)
	@$(VENV)/bin/ruff check .
	@$(VENV)/bin/mypy
	@$(VENV)/bin/lint-imports

setup: $(READY)

$(READY): requirements-dev.lock pyproject.toml
	@$(PYTHON) .ci/system.py
	@echo 'setting up $(VENV) (a few minutes the first time)'
	@$(PYTHON) -m venv $(VENV)
	@$(VENV)/bin/pip install --quiet --disable-pip-version-check -r requirements-dev.lock
	@$(VENV)/bin/pip install --quiet --disable-pip-version-check --no-deps --editable .
	@touch $@

lock:
	@$(PYTHON) .ci/lock.py > requirements-dev.lock.new
	@mv requirements-dev.lock.new requirements-dev.lock
