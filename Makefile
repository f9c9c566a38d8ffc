# Everything runs in a virtual environment that this file makes itself; needed are python3 (3.11 or newer) with venv
# and pip. Name another interpreter with PYTHON=python3.13, another place with VENV=/elsewhere.

PYTHON ?= python3
VENV ?= .venv
WORKERS ?= auto
BIN := $(VENV)/bin
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: help demo test slow lint docs clean

help:
	@echo "make demo   render a warped board, calibrate it, and write pictures and numbers into demo/"
	@echo "make test   the fast tests"
	@echo "make slow   the tests that take longer"
	@echo "make lint   style, types and layers"
	@echo "make docs   the documentation, in build/docs/html; its examples are run"
	@echo "make clean  remove what these made, the virtual environment included"

demo: $(VENV)/installed
	$(BIN)/pinholify demo -o demo

test: $(VENV)/installed-test
	$(BIN)/python -m pytest -n $(WORKERS) --maxprocesses 8 -m "not slow"

slow: $(VENV)/installed-test
	$(BIN)/python -m pytest -n $(WORKERS) --maxprocesses 8 -m slow || test $$? -eq 5  # 5: there are none

lint: $(VENV)/installed-lint
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

docs: $(VENV)/installed-docs
	rm -rf build/docs docs/gallery docs/generated
	$(BIN)/python -m sphinx -M html docs build/docs --fail-on-warning --nitpicky --quiet
	$(BIN)/python -m sphinx -M doctest docs build/docs --fail-on-warning --nitpicky --quiet

clean:
	rm -rf $(VENV) demo build dist docs/gallery docs/generated
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find src tests -name __pycache__ -type d -exec rm -rf {} +

$(VENV)/installed: EXTRAS =
$(VENV)/installed-test: EXTRAS = [test]
$(VENV)/installed-lint: EXTRAS = [test,lint]
$(VENV)/installed-docs: EXTRAS = [figures,docs]

$(VENV)/installed $(VENV)/installed-test $(VENV)/installed-lint $(VENV)/installed-docs: $(VENV)/made pyproject.toml constraints.txt
	@echo "Installing pinholify$(EXTRAS) into $(VENV); the first time takes a minute or two"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.$(EXTRAS)'
	@touch $@

$(VENV)/made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  version=$$($(PYTHON) -c 'import sys; print(sys.version.split()[0])' 2>/dev/null || echo missing); \
	  echo "pinholify needs Python 3.11 or newer, but $(PYTHON) is $$version:" \
	    "name a newer one, for example: make $(or $(MAKECMDGOALS),demo) PYTHON=python3.13" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV)
	@touch $@
