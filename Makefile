# `make demo` and `make test` do all the set-up; they need Python >= 3.11, make and git.
PYTHON ?= python3
VENV ?= .venv
WHEEL_VENV ?= .venv-wheel
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
WORKERS ?= 2
SIDE_BY_SIDE := $(BIN)/pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

.PHONY: demo test shapes test-all lint style mypy pyright wheel-test bench docs clean

demo: $(INSTALLED)
	$(BIN)/axcomp demo --out axcomp-demo

# More than half of it is compilation. With these emitters of XLA, few optimisations and one
# thread for each it takes a quarter of the time; what users compile with is tested by
# `make wheel-test` and `make test-all`.
test shapes: export XLA_FLAGS += --xla_cpu_use_fusion_emitters=false \
  --xla_cpu_parallel_codegen_split_count=1
test shapes: export JAX_DISABLE_MOST_OPTIMIZATIONS := 1
# A machine may ask Python to keep no bytecode: then both workers and each command that a
# test starts would compile all sources again, 4 s of CPU a time.
test shapes test-all: export PYTHONDONTWRITEBYTECODE :=
# What JAX compiles is kept from run to run, beside the source and not in the user's cache.
test shapes test-all: export JAX_COMPILATION_CACHE_DIR := $(CURDIR)/build/jax
test shapes test-all: export JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS := 0
test shapes test-all: export JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES := -1
# Checking shapes at each call is half of the time of many files: `make shapes` does so on one
# way through each package, and `make test-all`, like pytest by itself, always.
shapes: WAY := $(addprefix tests/models/test_, plane.py leadscrew.py friction.py surface.py) \
  $(addprefix tests/ident/, core joint/test_joint_fit.py friction/test_choice.py \
  test_cli_demo.py discover/test_discover_job.py joint_jobs/test_groups.py test_doctor.py \
  test_convert.py volumetric external/test_export.py)
test: $(INSTALLED)
	$(SIDE_BY_SIDE) -m "not heavy" --jaxtyping-packages=

shapes: $(INSTALLED)
	$(SIDE_BY_SIDE) -m "not heavy" $(WAY)

# With all repetitions.
test-all: $(INSTALLED)
	$(SIDE_BY_SIDE)

lint: style mypy pyright

style: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

mypy: $(INSTALLED)
	$(BIN)/mypy

pyright: $(INSTALLED)
	$(BIN)/pyright --pythonpath $(BIN)/python

# The wheel as a user gets it, in an environment of its own, from a folder that holds no
# source: what only works inside the checkout fails here. How things are computed was tested
# from source; here it is what packaging can break: imports, commands, the demo.
wheel-test: $(INSTALLED)
	rm -rf dist $(WHEEL_VENV)
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .
	$(PYTHON) -m venv $(WHEEL_VENV)
	$(WHEEL_VENV)/bin/python -m pip install --quiet --upgrade pip
	$(WHEEL_VENV)/bin/python -m pip install --quiet --constraint constraints.txt --group dev dist/axcomp-*.whl
	mkdir -p dist/empty
	cd dist/empty && ../../$(WHEEL_VENV)/bin/pytest -c ../../pyproject.toml --rootdir ../.. \
	  -o addopts="--import-mode=importlib -ra" ../../tests/packaging

# Without the run-time type checks of the tests, which would be timed too.
bench: $(INSTALLED)
	$(BIN)/pytest -o addopts="--import-mode=importlib" benchmarks --benchmark-only

# The pages that are written from the code, and the site of all pages in build/site.
docs: $(INSTALLED)
	$(BIN)/python -m axcomp.data.lists._document > docs/parameters.md
	$(BIN)/python docs/job_reference.py docs
	$(BIN)/python docs/pictures.py docs/compensations/pictures
	$(BIN)/axcomp demo --out axcomp-demo --picture docs/demo.png
	$(BIN)/mkdocs build --strict

$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group dev --editable .
	touch $(INSTALLED)

clean:
	rm -rf $(VENV) $(WHEEL_VENV) axcomp-demo axcomp-out build dist
