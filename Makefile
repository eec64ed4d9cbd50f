# `make` alone lists the targets. Each sets up the environment that it needs (tools/environment).

.PHONY: help demo test lint types figures figures-short clean
unexport PYTHONPATH
VENV := .venv/bin
UBUNTU := .venv-ubuntu24.04/bin
# More workers than the two cores that this must do with: tests of nodes mostly wait.
PYTEST := -m pytest -n 3 --dist worksteal
# Of figures, as `make figures OPTIONS='--against figures.json --seed 7'`.
OPTIONS :=

help:
	@echo 'make demo        set up .venv, then fly the payload on a simulated panel: out/demo/'
	@echo 'make test        set up .venv and run all tests; then again, those that need no ROS,'
	@echo "                 with Ubuntu 24.04's versions of numpy, SciPy and OpenCV"
	@echo 'make lint        ruff: style and format; import-linter: which way arrows run'
	@echo 'make types       mypy'
	@echo 'make figures     what it measures: figures.json and docs/results.md; 10 minutes on 2 cores'
	@echo 'make figures-short   a part of it, against figures.json: half a minute'
	@echo 'make clean       remove the environments and all that was generated'

demo:
	@tools/environment ros 'ftp-dent demo --output out/demo'
	$(VENV)/ftp-dent demo --output out/demo

test:
	@tools/environment test
	$(VENV)/python $(PYTEST)
	@tools/environment ubuntu24.04 || test $$? -eq 3
	@test ! -e $(UBUNTU)/../ready || (set -x; $(UBUNTU)/python $(PYTEST))

lint:
	@tools/environment test
	$(VENV)/ruff check .
	$(VENV)/ruff format --check .
	$(VENV)/lint-imports --no-cache

types:
	@tools/environment test
	$(VENV)/mypy

figures:
	@tools/environment test
	$(VENV)/python benchmarks/figures.py $(OPTIONS)

figures-short:
	@tools/environment test
	$(VENV)/python benchmarks/figures.py --short --against figures.json

clean:
	rm -rf .venv .venv-ubuntu24.04 build install log out *.egg-info \
		.pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
