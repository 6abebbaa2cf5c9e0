# Each target makes its own virtual environment and installs what it needs, pinned.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check

.PHONY: demo test test-all check bench prove studies docs plotly three clean

demo: $(VENV)/.base
	$(BIN)/steelyard demo -o $$(mktemp -d)/demo

# compiled tests are kept for the next time; a worker without work takes half of what the other has left
PYTEST = PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -q -n 2 --dist worksteal

test: $(VENV)/.test
	$(PYTEST) -m "not slow"

test-all: $(VENV)/.test
	$(PYTEST)

check: $(VENV)/.test $(VENV)/.check
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/.test
	$(BIN)/python benchmarks/run.py

prove: $(VENV)/.test
	$(BIN)/python -m proofs.run

studies: $(VENV)/.base
	@failed=0; for study in studies/p[0-9]_*.py; do \
		name=$$(basename $$study | cut -d_ -f1); \
		$(BIN)/python $$study -o results/$$name || failed=1; done; exit $$failed

docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build -q -d site
	@echo "site/index.html"

plotly:
	$(PYTHON) tools/update_browser_script.py plotly $(VERSION)

three:
	$(PYTHON) tools/update_browser_script.py three $(VERSION)

clean:
	rm -rf $(VENV)

$(VENV)/.python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
		|| { echo "steelyard needs Python 3.10 or newer; name one with make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.base: $(VENV)/.python pyproject.toml constraints.txt
	$(PIP) install -q -c constraints.txt -e .
	@touch $@

$(VENV)/.test: $(VENV)/.base
	$(PIP) install -q -c constraints.txt -e ".[test]"
	@touch $@

$(VENV)/.check: $(VENV)/.base
	$(PIP) install -q -c constraints.txt -e ".[check]"
	@touch $@

$(VENV)/.docs: $(VENV)/.base
	$(PIP) install -q -c constraints.txt -e ".[docs]"
	@touch $@
