# Sets up .venv from requirements-dev.lock on first use, and again only when the lock or pyproject.toml changes.
# `make PYTHON=/path/to/python3.12 …` takes another interpreter.

PYTHON ?= $(shell python3.11 -c '' 2>/dev/null && echo python3.11 || echo python3)
KERNEL ?= placement
CONFIG ?= configs/cantilever-youngs-modulus.yaml
ARGS ?=
VENV := .venv
# Where venv puts the commands.
BIN := $(if $(filter Windows_NT,$(OS)),Scripts,bin)
LOWEST := build/lowest
KERNELS := mesh fem rom foreign sensors loads placement estimation multibody damage
READY := $(VENV)/.ready
STAGES := import modes rom train screen observe place spectrum validate report
# A config that takes a guess from another run comes after those that do not.
CONFIGS = $(shell grep -L 'from:' configs/*.yaml) $(shell grep -l 'from:' configs/*.yaml)
# The hub of thesis 6.2 on the mesh of 316 000 unknowns. One run at a time: two would need more than 6 GiB.
FINE := --set name=hub-fine --set suffix=-fine --set set.mesh.file=../../meshes/hub.bdf.gz --set jobs=1
# Two test workers on two cores: more threads would only get in each other's way.
ONE_THREAD := OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
# Of the slow tests, chosen by the commit: eight commits reach all of them on average.
N ?= $(shell echo $$((0x$$(git rev-parse --short=8 HEAD 2>/dev/null || echo 0) % 8 + 1)))
# Files whose prose `make lint` checks: the changed ones; with `WORDS=` all, as in CI.
WORDS ?= --changed
# Modules that are compiled once start a worker in half the time.
TESTS := PYTHONDONTWRITEBYTECODE= $(ONE_THREAD) $(VENV)/$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -q

.PHONY: help run status test test-all shard lint all-configs hub hub-fine lug bench thesis manual release pages lowest coverage mutants fuzz soak history setup lock $(STAGES)
.DEFAULT_GOAL := help

help:
	@echo 'make run            set up, then every stage on CONFIG that is not up to date'
	@echo 'make STAGE          up to that stage: $(STAGES)'
	@echo 'make status         which stages are up to date, and why the others are not'
	@echo 'make all-configs    run on every file of configs/'
	@echo 'make hub            the hub of thesis 6.2: 25 runs of configs/hub/ and one page, results/hub/report.html'
	@echo 'make hub-fine       the same on the fine mesh, results/hub-fine/report.html'
	@echo 'make lug            modulus of a lug bracket with bolt holes, three loads on it, then all of these: configs/lug/'
	@echo 'make bench          chapters 2 to 4 of the thesis: 85 runs of configs/bench/ and one page, results/bench/report.html'
	@echo 'make thesis         the thesis as printed, beside ours, figure by figure: results/thesis/report.html'
	@echo 'make test           set up, then the tests, but for the long ones'
	@echo 'make test-all       all tests; ARGS=--times says where the processor time went'
	@echo 'make shard N=3      an eighth of the long tests; without N the one that CI runs for this commit'
	@echo 'make pages          the tests that open the pages in a browser; pictures of the pages in build/pages'
	@echo 'make lint           ruff, prose of changed files, mypy, import-linter; licences and known vulnerabilities of the packages'
	@echo 'make lowest         fast tests and the cantilever with the oldest packages that pyproject.toml allows'
	@echo 'make coverage       branches of the kernels that their fast tests reach; takes long'
	@echo 'make mutants        200 small faults in KERNEL=$(KERNEL), and which of them no test notices; takes long'
	@echo 'make fuzz           20 000 damaged configs, decks and measurements each, and more; what fails is put into build/fuzz'
	@echo 'make soak           10 million steps of the filter and 1000 placements, each in one process; takes an hour'
	@echo 'make history        ratios of processor times to other packages, kept in benchmarks/history'
	@echo 'make manual         the manual as a site: site/index.html'
	@echo 'make release        wheel and sdist in dist/, checked in an empty environment; prints what is left to do by hand'
	@echo 'make lock           renew requirements-dev.lock and .ci/lowest.lock from pyproject.toml'
	@echo
	@echo 'CONFIG=$(CONFIG)'
	@echo 'ARGS="--set place.keep=6" is passed on to strainsight'

run: $(READY)
	@$(VENV)/$(BIN)/strainsight run $(CONFIG) $(ARGS)

$(STAGES) status: $(READY)
	@$(VENV)/$(BIN)/strainsight $@ $(CONFIG) $(ARGS)

all-configs: $(READY)
	@set -e; for config in $(CONFIGS); do echo "== $$config"; $(VENV)/$(BIN)/strainsight run $$config $(ARGS); done

hub: $(READY)
	@$(VENV)/$(BIN)/strainsight run configs/hub/suite.yaml $(ARGS)

hub-fine: $(READY)
	@$(VENV)/$(BIN)/strainsight run configs/hub/suite.yaml $(FINE) $(ARGS)

lug: $(READY)
	@set -e; for name in lug-youngs-modulus lug-input lug-input-youngs-modulus; do $(VENV)/$(BIN)/strainsight run configs/lug/$$name.yaml $(ARGS); done

bench: $(READY)
	@$(VENV)/$(BIN)/strainsight run configs/bench/suite.yaml $(ARGS)

thesis: $(READY)
	@$(VENV)/$(BIN)/strainsight run configs/thesis/suite.yaml $(ARGS)

test: $(READY)
	@$(TESTS) -m 'not slow' $(ARGS)

test-all: $(READY)
	@$(TESTS) $(ARGS)

shard: $(READY)
	@echo 'shard $(N) of 8 of the long tests'
	@$(TESTS) --shard $(N) $(ARGS)

pages: $(READY)
	@$(ONE_THREAD) $(VENV)/$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -q tests/browser $(ARGS)
	@echo 'pictures of the pages: build/pages'

# Compiled code is invisible to the measurement: the multibody tests run without the compiler, which takes long. What is odd
# about a mesh is tested on decks.
coverage: $(READY)
	@mkdir -p build
	@$(ONE_THREAD) $(VENV)/$(BIN)/coverage run -m pytest -q -p no:cov -m 'not slow' $(filter-out tests/multibody,$(KERNELS:%=tests/%)) tests/decks
	@NUMBA_DISABLE_JIT=1 $(ONE_THREAD) $(VENV)/$(BIN)/coverage run --append -m pytest -q -p no:cov -m 'not slow' tests/multibody
	@$(VENV)/$(BIN)/coverage report

mutants: $(READY)
	@$(ONE_THREAD) $(VENV)/$(BIN)/python -m tests.mutants $(KERNEL) $(ARGS)

# A page, a drawing or a written-out schema may differ by the versions of what draws and writes them.
lowest:
	@$(PYTHON) .ci/system.py
	@$(PYTHON) -m venv $(LOWEST)
	@$(LOWEST)/$(BIN)/pip install --quiet --disable-pip-version-check --no-deps -r .ci/lowest.lock
	@$(LOWEST)/$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-index --no-build-isolation --editable .
	@$(ONE_THREAD) NUMBA_CACHE_DIR=$(LOWEST)/numba $(LOWEST)/$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -q -m 'not slow' \
		--deselect tests/config/test_load.py::test_the_committed_schema_is_that_of_the_models $(KERNELS:%=tests/%) \
		tests/config tests/decks tests/measurements tests/pages tests/cli tests/runner tests/parallel $(ARGS)
	@$(LOWEST)/$(BIN)/strainsight run configs/cantilever-youngs-modulus.yaml --results $(LOWEST)/results

# atheris has wheels for some systems only; without one that part is left out.
fuzz: $(READY)
	@$(VENV)/$(BIN)/pip install --quiet --disable-pip-version-check --only-binary :all: 'atheris>=3.0' || true
	@$(ONE_THREAD) $(VENV)/$(BIN)/python -m tests.fuzz.campaign $(ARGS)
	@$(ONE_THREAD) $(VENV)/$(BIN)/python -W ignore -m tests.fuzz.structured
	@$(ONE_THREAD) $(VENV)/$(BIN)/python -m tests.fuzz.commands
	@$(ONE_THREAD) $(VENV)/$(BIN)/python -m tests.fuzz.guided

soak: $(READY)
	@STRAINSIGHT_STEPS=10_000_000 STRAINSIGHT_PLACEMENTS=1000 $(ONE_THREAD) \
		$(VENV)/$(BIN)/pytest -q tests/robustness/test_soak.py $(ARGS)

history: $(READY)
	@$(VENV)/$(BIN)/python -m benchmarks.history

lint: $(READY)
	@$(VENV)/$(BIN)/ruff check .
	@$(VENV)/$(BIN)/ruff format --check --quiet pipeline cli
	@$(VENV)/$(BIN)/python .ci/prose.py $(WORDS)
	@$(VENV)/$(BIN)/mypy
	@$(VENV)/$(BIN)/lint-imports
	@$(VENV)/$(BIN)/python .ci/licences.py
	@$(VENV)/$(BIN)/pip check --quiet --disable-pip-version-check
	@$(VENV)/$(BIN)/python .ci/audit.py

manual: $(READY)
	@$(VENV)/$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --doctree-dir .sphinx docs site
	@echo site/index.html

release: $(READY)
	@$(VENV)/$(BIN)/python .ci/release.py

setup: $(READY)

# The locks are complete: with hashes pip does not take the pinned coverage for the coverage[toml] that pytest-cov asks for.
$(READY): requirements-dev.lock pyproject.toml
	@$(PYTHON) .ci/system.py
	@echo 'setting up $(VENV) (a few minutes the first time)'
	@$(PYTHON) -m venv $(VENV)
	@$(VENV)/$(BIN)/pip install --quiet --disable-pip-version-check --no-deps -r requirements-dev.lock
	@$(VENV)/$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-index --no-build-isolation --editable .
	@touch $@

lock:
	@$(PYTHON) .ci/lock.py > requirements-dev.lock.new
	@$(PYTHON) .ci/lock.py --lowest > .ci/lowest.lock.new
	@mv requirements-dev.lock.new requirements-dev.lock
	@mv .ci/lowest.lock.new .ci/lowest.lock
