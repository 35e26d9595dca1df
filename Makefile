# Two commands from nothing: `make run` does the main job, `make test` passes the tests.
# Each sets up its own virtual environment in .venv first.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# What is never imported need not be compiled: half of the time that setting up takes.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile

# Every process of a test loads the same modules: their bytecode is kept, whatever the environment says. Without it
# each compiles SymPy, NumPy and the project anew, which takes longer than most of what it then does.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: run all test thorough unit firmware mutants lint types current check bench clean

# The paper's drive generated, proved and simulated, and build/report/index.html. From nothing, the environment
# included: 90 s on two cores. What is proved is kept under a hash of all it depends on; again: 10 s.
run: $(VENV)/.ready
	$(BIN)/pmsm-ickf run

# Every drive, emulated processors, static checks, peers, ablation, sample times: minutes; again, with what is kept: one.
all: $(VENV)/.ready
	$(BIN)/pmsm-ickf run --all

# Every statement on the drives that have every feature between them. Six to eight minutes.
test: $(VENV)/.ready-dev
	$(BIN)/python -m pytest -n auto --dist worksteal -m "not thorough"

# The same of every drive, with more faults, combinations and draws, and whole documents: before a release. A quarter of an hour.
thorough: $(VENV)/.ready-dev
	$(BIN)/python -m pytest -n auto --dist worksteal --hypothesis-profile many

# Pure Python, no compiler: what to run after every change. Under a minute.
unit: $(VENV)/.ready-dev
	$(BIN)/python -m pytest -n auto --dist worksteal -m "unit and not process and not slow and not thorough"

# The generated C away from the host. Debian: gcc-avr avr-libc simavr, gcc-arm-none-eabi libnewlib-arm-none-eabi
# qemu-system-arm, clang cppcheck frama-c-base valgrind. Without them `make test` skips, saying so.
firmware: $(VENV)/.ready
	$(BIN)/pmsm-ickf firmware

# The mutation score of the proof: hundreds of small errors, each of which a link or a test must notice. Fifty minutes.
mutants: $(VENV)/.ready-dev
	$(BIN)/python -m tests.mutants

# Cost beside peers, then how fast the drive simulates. A peer that cannot be installed is named in its row.
bench: $(VENV)/.ready
	$(INSTALL) -e '.[bench]' || echo "some peers could not be installed"
	$(BIN)/python benchmarks/cost.py
	$(BIN)/python benchmarks/simulation.py
	$(BIN)/python benchmarks/batch.py
	$(BIN)/python benchmarks/generate.py

lint: $(VENV)/.ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.ready-dev
	$(BIN)/mypy

current: $(VENV)/.ready-dev
	$(BIN)/pmsm-ickf generate --check

# What CI adds to the tests.
check: lint types current

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.ready: $(VENV)/bin/python pyproject.toml
	$(INSTALL) -e '.[report]'
	touch $@

$(VENV)/.ready-dev: $(VENV)/bin/python pyproject.toml
	$(INSTALL) -e '.[dev]'
	touch $@ $(VENV)/.ready

clean:
	rm -rf $(VENV) build *.egg-info
