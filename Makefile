# Both commands set everything up by themselves: Python >= 3.11, make and the package registry are all they need.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
CORE = -n 2 --dist worksteal -m "not long and not package and not outside and not browser and not docs"

# The tests start hundreds of interpreters, each of which would compile everything anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo check test test-browser test-docs test-long test-outside test-package lint bench docs book numbers clean

demo: $(VENV)/installed $(VENV)/core
	@PATH="$(CURDIR)/$(BIN):$$PATH" sh examples/demo.sh out

# What is to pass before every commit, in a minute: lint, types, contracts, and the tests of what changed since BASE.
BASE ?= main
check: lint $(VENV)/core
	@tests=$$($(BIN)/python tests/changed.py $(BASE)) || exit; echo $$tests; \
	[ -z "$$tests" ] || $(BIN)/python -m pytest $(CORE) $$tests || [ $$? = 5 ]  # 5: none of them is in the core suite

test: lint $(VENV)/core
	$(BIN)/python -m pytest $(CORE)

test-long: $(VENV)/developed $(VENV)/core
	$(BIN)/python -m pytest -m long

# What is generated, linked and shown to readers, and every block of code of README and docs, page by page.
test-docs: $(VENV)/developed $(VENV)/core
	$(BIN)/python -m pytest -rs -n 2 --dist worksteal tests/docs tests/examples tests/test_doctests.py tests/test_packaging.py

# Our files in slicers, CAD, viewers and simulators. Installs none of these; what is missing is skipped by name.
test-outside: $(VENV)/developed
	$(BIN)/python -m pytest -rs -m outside tests/outside

# Our pages in an installed Chromium: what they show, react to, and whether everyone can read them.
test-browser: $(VENV)/developed $(VENV)/core
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group browser
	$(BIN)/python -m pytest -rs -m browser tests/browser

# Builds, installs without and with extras, runs every command: needs the package index, and 3 GB for a while.
test-package: $(VENV)/packaged
	$(BIN)/python -m pytest -m package tests/package

lint: $(VENV)/developed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/developed $(VENV)/core
	$(BIN)/python -m benchmarks

docs: $(VENV)/developed
	$(BIN)/python -m docs.generate

# README's and docs' pages as one site in out/book; a warning is an error.
book: $(VENV)/developed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group book
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build

# Runs every command that README and docs name for their numbers, and fails where the text has another.
numbers: $(VENV)/developed $(VENV)/core
	$(BIN)/python -m docs.numbers

clean:
	rm -rf $(VENV) out

$(VENV)/python:
	$(PYTHON) -c 'import sys; sys.exit("markergen needs Python >= 3.11, found " + sys.version.split()[0] + "; call make PYTHON=python3.11" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --upgrade pip
	touch $@

# Users need the kernel of cadquery alone, and with it a third of the size.
$(VENV)/installed: $(VENV)/python pyproject.toml detector/pyproject.toml constraints.txt
	@echo "Installing markergen and what it needs (about 0.8 GB the first time, a minute)..."
	@# Python compiles what it imports; compiling everything beforehand took longer than the rest of the installation.
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable ./detector --editable '.[$(if $(wildcard $(VENV)/developed),all,step)]'
	touch $@

# The detector's compiled core, once more after a change; where there is no compiler, the package ziglang is one.
$(VENV)/core: $(VENV)/installed $(wildcard detector/src/*.[ch]) detector/build_core.py
	@$(BIN)/python detector/build_core.py || { $(BIN)/python -m pip install --quiet ziglang && $(BIN)/python detector/build_core.py; }
	@touch $@

# All of cadquery replaces its kernel alone: both bring the same module.
$(VENV)/developed: $(VENV)/python pyproject.toml detector/pyproject.toml constraints.txt
	@echo "Installing markergen and what its tests need (about 2 GB the first time, a few minutes)..."
	@rm -f $(VENV)/installed
	@$(BIN)/python -m pip uninstall --quiet --yes cadquery-ocp-novtk 2>/dev/null
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable ./detector --editable '.[all]' --group dev
	touch $(VENV)/installed $@

$(VENV)/packaged: $(VENV)/developed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --group package
	touch $@
