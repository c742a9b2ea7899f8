# All targets run in .venv, which is created on first use and updated when needed.
# Variables: PYTHON, the interpreter; PYTEST_ARGS, e.g. -k truss; WORKERS, number of test processes;
# CAMPAIGN, size of the campaign; VENV and EXTRA, another environment and its extra.
# Tests with another Python: make test PYTHON=python3.13 VENV=.venv-3.13 EXTRA=test

PYTHON ?= python3
WORKERS ?= 3
CAMPAIGN ?= 1

# Hundreds of test processes import the packages: bytecode is cached, also where the environment disables that.
unexport PYTHONDONTWRITEBYTECODE

VENV ?= .venv
EXTRA ?= dev
OLDEST := .venv-oldest
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
# Python compiles the modules that it imports; pip would compile all of them, in half of its time.
PIP_INSTALL := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check

.PHONY: help transport live reproduce flight sweep modes reports-check check types rules test campaign environment-oldest test-oldest format docs bench bench-check bench-peers bench-solvers clean FORCE
.DELETE_ON_ERROR:

help:
	@echo "make transport  simulate Case 1 of the paper: results/case1/index.html"
	@echo "make live       the same, and a page that simulates it in the browser: results/case1/live.html"
	@echo "make reproduce  simulate and check the claims of the paper: docs/reproduction"
	@echo "make flight     robustness of the controllers, 200 Monte Carlo samples of each case: docs/flight"
	@echo "make sweep      1000 Monte Carlo samples of each controller: docs/sweep"
	@echo "make modes      modes, margins and spillover of the truss: results/modes"
	@echo "make reports-check  compare the loops of docs/reproduction with the present code, without runs"
	@echo "make check      check format, style, types, imports, docstrings, links and prose"
	@echo "make test       check every law once"
	@echo "make campaign   run random cases, killed processes, faults and long runs; CAMPAIGN=10 runs ten times as many"
	@echo "make test-oldest  run tests of blocks with the oldest allowed libraries"
	@echo "make format     format the code"
	@echo "make docs       build the site: site/index.html"
	@echo "make bench      run the benchmarks"
	@echo "make bench-check  run the benchmarks that are ratios; fail if one is far above its limit"
	@echo "make bench-solvers  compare variable steps with CasADi's generated C and SciPy"
	@echo "make bench-peers  compare five systems with events with PathSim and SciPy"
	@echo "make clean      remove .venv* and all built files; keep results"

transport: $(VENV)/runtime.stamp
	$(BIN)/python -m trussflow.models.transport --case 1 --output results/case1

# Also results/case1/live.html, which simulates Case 1 in the browser with sliders.
live: $(VENV)/compiler.stamp
	$(BIN)/python -m trussflow.models.transport --case 1 --live --output results/case1

# The studies are packages of examples/studies.
STUDY := PYTHONPATH=examples/studies $(BIN)/python -m

reproduce: $(VENV)/runtime.stamp
	$(STUDY) reproduction --output docs/reproduction

flight: $(VENV)/runtime.stamp
	$(STUDY) flight --output docs/flight

sweep: $(VENV)/runtime.stamp
	$(STUDY) flight --samples 1000 --output docs/sweep

# Parts of the reports of `make flight` and `make sweep` are of revision 81363a8e (docs/limitations.md), so only that
# of the paper is checked.
reports-check: $(VENV)/runtime.stamp
	$(STUDY) reproduction --check --output docs/reproduction

modes: $(VENV)/runtime.stamp
	PYTHONPATH=examples/studies $(BIN)/python examples/studies/modes/modes.py

# One thread per worker for linear algebra: the workers already fill the cores.
# Without optimization: a quarter of the time is that of the compiler. The results are equal bit by bit, which the
# campaign tests; examples, reports and benchmarks run optimized code.
RUN_TESTS := TRUSSFLOW_CFLAGS=-O0 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS)

# Rules about the code itself, which `make check` tests.
RULES := $(addprefix tests/test_, architecture.py docstrings.py documents.py prose.py)

test: $(VENV)/dev.stamp
	$(RUN_TESTS) --dist loadfile --no-loadscope-reorder $(addprefix --ignore=, $(RULES)) $(PYTEST_ARGS)

campaign: $(VENV)/dev.stamp
	CAMPAIGN=$(CAMPAIGN) $(RUN_TESTS) --dist worksteal -m "campaign or hypothesis" --hypothesis-profile=campaign $(PYTEST_ARGS)

# The tests of what depends on the versions of libraries. Warnings of old libraries about deprecations are no
# errors here.
OLDEST_TESTS := $(addprefix tests/blocks/, tracing library/test_whole_library.py control linear_analysis \
  $(addprefix simulation/test_, adaptive.py results.py streamed_log.py))

environment-oldest:
	$(MAKE) VENV=$(OLDEST) $(OLDEST)/pyvenv.cfg
	$(PYTHON) tests/oldest.py > $(OLDEST)/pins.txt
	PIP_CONSTRAINT=$(OLDEST)/pins.txt $(MAKE) VENV=$(OLDEST) EXTRA=test $(OLDEST)/dev.stamp

test-oldest: environment-oldest
	$(MAKE) test VENV=$(OLDEST) EXTRA=test PYTEST_ARGS='-W default $(OLDEST_TESTS)'

check: $(VENV)/dev.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(MAKE) --jobs 2 --output-sync types rules

types:
	$(BIN)/mypy -p trussflow
	MYPYPATH=examples/studies $(BIN)/mypy --allow-untyped-defs --allow-untyped-calls $(wildcard examples/*.py examples/*/*.py examples/studies/*/*.py)

rules:
	$(BIN)/python -m pytest -q $(RULES)

format: $(VENV)/dev.stamp
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# Runs every example; a warning, such as a dead link, is an error.
docs: $(VENV)/dev.stamp
	MPLBACKEND=Agg $(BIN)/python -m sphinx -q -W --keep-going -d site/.doctrees -b html docs site
	@echo "open site/index.html in a browser"

bench: $(VENV)/dev.stamp
	$(BIN)/python tests/benchmarks/run.py

bench-solvers: $(VENV)/dev.stamp
	$(BIN)/python tests/benchmarks/solvers.py

bench-check: $(VENV)/dev.stamp
	$(BIN)/python tests/benchmarks/run.py --check

# PathSim has an environment of its own.
bench-peers:
	$(MAKE) VENV=.venv-peers EXTRA=peers .venv-peers/dev.stamp
	.venv-peers/bin/python tests/benchmarks/peers.py

clean:
	rm -rf .venv .venv-* build dist site docs/gallery docs/pages docs/reference .compiled *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find blocks models fmu tests examples -name __pycache__ -prune -exec rm -rf {} +

# Environment. An editable install links files one by one, so it is renewed when a file is added or removed.
# All environments use the same links (build/__editable__*): nothing else may run while one is installed.
# Missions need fewer packages than development: one stamp each.

$(VENV)/runtime.stamp: pyproject.toml $(VENV)/sources
	@echo "Installing trussflow into $(VENV) (the first time takes a minute or two)"
	$(PIP_INSTALL) -e .
	@touch $@

$(VENV)/compiler.stamp: $(VENV)/runtime.stamp
	@$(PIP_INSTALL) -e ".[compiler]"
	@touch $@

$(VENV)/dev.stamp: pyproject.toml $(VENV)/sources
	@echo "Installing trussflow and its development tools into $(VENV) (the first time takes a few minutes)"
	$(PIP_INSTALL) -e ".[$(EXTRA)]"
	@touch $@ $(VENV)/runtime.stamp

$(VENV)/sources: FORCE | $(VENV)/pyvenv.cfg
	@new=$@.$$$$; find blocks models fmu -type f ! -path '*/__pycache__/*' | sort > $$new; \
	  if cmp -s $$new $@; then rm $$new; else mv $$new $@; fi

$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "trussflow needs Python 3.11 or newer, and '$(PYTHON)' is not; name one: make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); exit 1; }
