# Every target sets up what it needs in a virtual environment of its own, .venv.
# PyBullet has wheels only up to Python 3.11, so that one is preferred where it is installed.
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV ?= .venv
DOCS_VENV ?= .venv-docs
BIN = $(VENV)/bin
NPM := $(shell command -v npm)
# Our matrices are small: a second thread of BLAS only waits for a core.
export OPENBLAS_NUM_THREADS ?= 1
# Hundreds of processes start in a test run: where compiled modules may not be written, each compiles ours again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: compare demo test long-tests all-tests accurate coverage mutation fuzz lint docs benchmark clean

compare: $(VENV)/main ## run all engines on the 10:1 trial and write report/ten_to_one/report.md
	$(BIN)/looping-pendulum compare ten_to_one --profile quick --out report/ten_to_one

demo: $(VENV)/main ## run all engines on the 10:1 trial, and open the demonstration: reference and engines in step
	@echo "Running all engines on the 10:1 trial (half a minute), then opening the page in a browser ..."
	$(BIN)/looping-pendulum demo

# Three at once on two cores: many tests wait for a browser or for another process.
PYTEST = $(BIN)/python $(if $(BACKEND),-m tests.backends $(BACKEND)) -m pytest -n 3 --dist worksteal --durations=40
test: $(VENV)/test $(if $(NPM),node_modules) ## run the quick tests (five minutes); BACKEND=old-processor: as on such a machine (`python -m tests.backends`)
	$(PYTEST) -m "not long and not accurate"

long-tests: $(VENV)/test $(if $(NPM),node_modules) ## run the tests that are too long for `make test` (about a quarter of an hour)
	$(PYTEST) -m "long and not accurate"

all-tests: $(VENV)/test $(if $(NPM),node_modules) ## run all tests but the hour of `accurate`
	$(PYTEST) -m "not accurate"

accurate: $(VENV)/test ## run the long accuracy tests: accurate profiles, the blind matrix, the pendulum (about an hour)
	$(BIN)/python -m pytest -m accurate -n 2

# Quick tests of what calculates, in one process: the whole suite, which spends most of its time in other processes, would take longer still.
COVERED = tests/scenarios tests/reference_ode/core/test_bits.py \
	$(addprefix tests/reference_ode/test_,batch.py closed_forms.py impact.py newton.py parameters_and_geometry.py parts.py \
		sensitivity.py solution.py solve.py) \
	$(addprefix tests/compare/test_,baseline.py landmarks.py metrics.py metrics_by_hand.py report_cells.py \
		result.py signs_and_units.py stories.py tables.py) \
	tests/runs/test_detector.py \
	$(addprefix tests/discrepancy/test_,held_out.py likelihood.py) \
	$(addprefix tests/measured/test_,measurement.py study.py) \
	$(addprefix tests/measured/tables/test_,readers.py readers_generated.py trial_files.py)
# From Python 3.12 on by sys.monitoring, below by coverage's tracer in C. Both about double the time: 733 tests on 3.13 took 16.4 s of a
# processor with the former, 17.1 s with the latter and 8.0 s without either.
coverage: $(VENV)/coverage ## lines that quick tests of the calculating packages run; fails below the floor in pyproject.toml
	COVERAGE_CORE=$$($(BIN)/python -c 'import sys; print("sysmon" if sys.version_info >= (3, 12) else "ctrace")') \
		$(BIN)/python -m coverage run -m pytest --quiet -p no:cacheprovider $(COVERED)
	$(BIN)/python -m coverage report

# Interrupted, it goes on where it was; a mutant that was then in place is taken back by `git checkout`.
mutation: $(VENV)/mutation mutation.sqlite ## seed faults into the files that cosmic-ray.toml names, and list those that no test notices (hours)
	$(BIN)/cosmic-ray exec cosmic-ray.toml mutation.sqlite
	$(BIN)/cr-report --surviving-only --show-diff mutation.sqlite

mutation.sqlite: cosmic-ray.toml | $(VENV)/mutation
	$(BIN)/cosmic-ray baseline $<
	$(BIN)/cosmic-ray init --force $< $@
	$(BIN)/cr-filter-operators $@ $<

fuzz: $(VENV)/test ## try 20 000 damaged files, quantities and command lines (half an hour)
	FUZZ_EXAMPLES=2200 $(BIN)/python -m pytest -n 2 --timeout 0 tests/fuzz/test_damaged.py tests/measured/tables/test_readers_generated.py

lint: $(VENV)/dev $(if $(NPM),node_modules) ## style, types, and the one-way direction of the imports; the live page's JavaScript, where npm is
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy && $(BIN)/lint-imports
	$(if $(NPM),npm run --silent check,@echo "npm was not found (Debian: apt install npm): the live page's JavaScript was not checked")

docs: $(VENV)/dev $(DOCS_VENV)/docs ## build the documentation's site into site/
	$(BIN)/python -m scripts.written_pages
	NO_MKDOCS_2_WARNING=1 $(DOCS_VENV)/bin/mkdocs build --strict

benchmark: $(VENV)/test ## time what users wait for
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) $(DOCS_VENV) node_modules build report site *.egg-info .coverage mutation.sqlite

# uv installs in a tenth of pip's time, but knows no settings of pip's, such as a house's own index: where it fails, pip tries.
install = $(BIN)/uv pip install --quiet --python $(1)/bin/python $(2) || \
	{ $(1)/bin/python -m pip install --quiet --upgrade pip && $(1)/bin/python -m pip install --quiet $(2); }

# Packages come without a line of their own for minutes, so that each step says what it does.
$(VENV)/uv:
	@echo "Setting up a virtual environment in $(VENV), with uv, which installs the packages ..."
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet uv || echo "uv cannot be had: pip will install"
	touch $@

$(VENV)/main: $(VENV)/uv pyproject.toml
	@echo "Installing this package and its engines (0.8 GB, one to five minutes at the first time) ..."
	$(call install,$(VENV),-e .)
	touch $@

$(VENV)/test: $(VENV)/uv pyproject.toml
	@echo "Installing this package, its engines and what the tests need (one to five minutes at the first time) ..."
	$(call install,$(VENV),-e ".[test]")
	touch $@ $(VENV)/main

$(VENV)/coverage: $(VENV)/uv pyproject.toml
	$(call install,$(VENV),-e ".[coverage]")
	touch $@ $(VENV)/test $(VENV)/main

$(VENV)/mutation: $(VENV)/uv pyproject.toml
	$(call install,$(VENV),-e ".[mutation]")
	touch $@ $(VENV)/test $(VENV)/main

$(VENV)/dev: $(VENV)/uv pyproject.toml
	@echo "Installing this package, its engines, and what tests and checks need (one to five minutes at the first time) ..."
	$(call install,$(VENV),-e ".[dev]")
	touch $@ $(VENV)/test $(VENV)/main

$(DOCS_VENV)/docs: $(VENV)/uv pyproject.toml
	$(PYTHON) -m venv $(DOCS_VENV)
	$(call install,$(DOCS_VENV),--group docs)
	touch $@

# TypeScript, ESLint, esbuild and what the page has of others, as the lock file has them. It names no addresses of packages, so that npm takes them from where it is set up to.
node_modules: package-lock.json
	npm ci --loglevel=error --no-audit --no-fund
	touch $@
