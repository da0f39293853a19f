# Every target sets up what it needs in a virtual environment of its own, .venv.
# PyBullet has wheels only up to Python 3.11, so that one is preferred where it is installed.
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV ?= .venv
BIN = $(VENV)/bin
DATA ?= ../shared/data
# Our matrices are small: a second thread of BLAS only waits for a core.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: compare demo test accurate lint docs benchmark infer clean

compare: $(VENV)/main ## run all engines on the 10:1 trial and write report/ten_to_one/report.md
	$(BIN)/looping-pendulum compare ten_to_one --profile quick --out report/ten_to_one

demo: $(VENV)/main ## the demonstration page: all engines and the truth, in step
	$(BIN)/looping-pendulum demo

test: $(VENV)/test ## run the tests (some minutes); BACKEND=scipy, old-processor, ...: as on another machine (`python -m tests.backends`)
	$(BIN)/python $(if $(BACKEND),-m tests.backends $(BACKEND)) -m pytest -n 2 --dist worksteal

accurate: $(VENV)/test ## run the long accuracy tests: accurate profiles, the blind matrix, the pendulum (about an hour)
	$(BIN)/python -m pytest -m accurate -n 2

lint: $(VENV)/dev ## style, types, and the one-way direction of the imports
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy && $(BIN)/lint-imports

docs: $(VENV)/dev ## build the documentation's site into site/
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

benchmark: $(VENV)/test ## time what users wait for
	$(BIN)/python -m benchmarks

infer: $(VENV)/main ## infer what the paper does not print (needs the data folder)
	$(BIN)/python scripts/infer_paper_trials.py --data $(DATA)

clean:
	rm -rf $(VENV) build report site *.egg-info

$(VENV)/pip:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	touch $@

$(VENV)/main: $(VENV)/pip pyproject.toml
	$(BIN)/python -m pip install --quiet -e .
	touch $@

$(VENV)/test: $(VENV)/pip pyproject.toml
	$(BIN)/python -m pip install --quiet -e ".[test]"
	touch $@ $(VENV)/main

$(VENV)/dev: $(VENV)/pip pyproject.toml
	$(BIN)/python -m pip install --quiet -e ".[dev]"
	touch $@ $(VENV)/test $(VENV)/main
