# Two commands from nothing: `make run` does the main job, `make test` passes the tests.
# Each sets up its own virtual environment in .venv first.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: run test firmware quick mutants lint types check bench clean

run: $(VENV)/.ready
	$(BIN)/pmsm-ickf run

test: $(VENV)/.ready-dev
	$(BIN)/python -m pytest -n auto --dist worksteal

# The generated C away from the host. Debian: gcc-avr avr-libc simavr, gcc-arm-none-eabi libnewlib-arm-none-eabi
# qemu-system-arm, clang cppcheck frama-c-base valgrind. Without them `make test` skips, saying so.
firmware: $(VENV)/.ready
	$(BIN)/pmsm-ickf firmware

# The tests without the slow ones.
quick: $(VENV)/.ready-dev
	$(BIN)/python -m pytest -n auto --dist worksteal -m "not slow"

# The mutation score of the proof: hundreds of small errors, each of which a link or a test must notice. A quarter of an hour.
mutants: $(VENV)/.ready-dev
	$(BIN)/python -m tests.mutants

# Cost beside peers, then how fast the drive simulates. A peer that cannot be installed is named in its row.
bench: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet -e '.[bench]' || echo "some peers could not be installed"
	$(BIN)/python benchmarks/cost.py
	$(BIN)/python benchmarks/simulation.py
	$(BIN)/python benchmarks/batch.py

lint: $(VENV)/.ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.ready-dev
	$(BIN)/mypy

# What CI adds to the tests.
check: lint types
	$(BIN)/pmsm-ickf generate --check

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.ready: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet -e '.[report]'
	touch $@

$(VENV)/.ready-dev: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet -e '.[dev]'
	touch $@ $(VENV)/.ready

clean:
	rm -rf $(VENV) build *.egg-info
