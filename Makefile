# `make demo` and `make test` do all the set-up; they need Python >= 3.11, make and git.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: demo test lint wheel-test bench clean

demo: $(INSTALLED)
	$(BIN)/axcomp demo --out axcomp-demo

test: $(INSTALLED)
	$(BIN)/pytest -n 2 --dist loadfile

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pyright

bench: $(INSTALLED)
	$(BIN)/pytest benchmarks --benchmark-only -n 0

$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group dev --editable .
	touch $(INSTALLED)

clean:
	rm -rf $(VENV) axcomp-demo axcomp-out dist
