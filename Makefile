# `make study` (the main job) and `make test` create what they need; nothing but Python 3.11+ and make is assumed.
PYTHON ?= python3
BIN := .venv/bin
ENVIRONMENT := .venv/.complete
# The matrices are small: threads of BLAS would only wait for each other.
export OPENBLAS_NUM_THREADS := 1
# glibc keeps the memory of large arrays: fetching it anew from the kernel costs a sixth of the time.
export MALLOC_MMAP_THRESHOLD_ := 33554432
export MALLOC_TRIM_THRESHOLD_ := 4294967296

.PHONY: help fuzz study test kernels suite test-fast check benchmark baseline lock clean

help:
	@echo 'make study      design the deadbeat feedforward for the default machine, validate it, write its report'
	@echo 'make test       format, lint, types and all tests'
	@echo 'make test-fast  the tests that run no whole study or diagnosis, for the daily loop'
	@echo 'make check      format, lint and types'
	@echo 'make fuzz       spoil ten thousand machine files; each has to be refused in a line or designed for'
	@echo 'make benchmark  time and error of the simulator beside what one would use instead, times of designs and diagnosis'
	@echo 'make baseline   keep the quick runs that the tests compare with'
	@echo 'make lock       pin the newest dependencies of requirements.in in requirements.lock'
	@echo 'make clean      remove the environment, caches and generated reports'

study: $(ENVIRONMENT)
	$(BIN)/python -m studies.deadbeat_design

# Side by side: the type checker uses one core only.
test: $(ENVIRONMENT)
	$(MAKE) --jobs 2 check suite

# Compiled once, and not by each process of tests anew.
kernels: $(ENVIRONMENT)
	$(BIN)/python -m tests.kernels

suite: kernels
	$(BIN)/python -m pytest --numprocesses logical --dist worksteal

test-fast: kernels
	$(BIN)/python -m pytest --numprocesses logical --dist worksteal -m 'not slow'

check: $(ENVIRONMENT)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

# Ten thousand spoiled machine files, of which the tests try five hundred; a few minutes.
fuzz: $(ENVIRONMENT)
	$(BIN)/python -m tests.studies.fuzz

benchmark: $(ENVIRONMENT)
	$(BIN)/python -m tests.benchmark
	$(BIN)/python -m tests.benchmark.optimal_control
	$(BIN)/python -m tests.benchmark.diagnosis

# What the tests compare quick runs with: only after a change of results that was meant, and read before it is committed.
baseline: $(ENVIRONMENT)
	$(BIN)/python -m tests.studies.baseline

# Made in one piece or not at all: the mark is set last, and a broken environment is begun anew.
$(ENVIRONMENT): requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo 'error: $(PYTHON) is older than Python 3.11; run make PYTHON=/path/to/a/newer/python'; exit 2; }
	rm -rf .venv
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: \
	    -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --no-index \
	    --editable .
	touch $@

lock: $(ENVIRONMENT)
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/python -m uv pip compile --upgrade --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
	    --custom-compile-command 'make lock' requirements.in --output-file requirements.lock

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis reports/out build *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
