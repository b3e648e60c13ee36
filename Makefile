# Each target does its own set-up; `make` lists them.
# Variables: PYTHON (any Python from 3.11), HOST, PORT, DATA, PYTEST (extra pytest options).

PYTHON ?= python3
# Not from the environment, where some shells keep the machine's own name.
HOST = 127.0.0.1
PORT ?= 8000
DATA ?= data
# Three workers keep two processors busy: much of the time goes into processes that the tests wait for. The order is that
# of tests/conftest.py: by itself xdist begins with files of many tests and ends with the few long ones. -n 0 debugs in one
# process.
PYTEST ?= -n 3 --dist loadfile --no-loadscope-reorder

.DEFAULT_GOAL := help
.NOTPARALLEL:
MAKEFLAGS += --no-print-directory

# Newer than pyproject.toml and constraints.txt: nothing to do. A venv holds its own path and links to its Python,
# so a moved folder and a vanished Python are set up again. The folder's name may hold spaces.
READY := .venv/ready
ifneq ($(shell .venv/bin/python -c '' 2>/dev/null && cat .venv/folder 2>/dev/null),$(CURDIR))
.PHONY: $(READY)
endif

.PHONY: help setup run test check lint bench paper screenshots dist clean browser ros

help: ## Show this list
	@echo "Tidemap: every cell of the map remembers its rhythm."
	@echo
	@grep -E '^[a-z]+:.*## ' Makefile | sed -E 's/^([a-z]+):[^#]*## /\1\t/' | while IFS="$$(printf '\t')" read -r name what; do \
	    printf '  make %-11s %s\n' "$$name" "$$what"; done

setup: $(READY) ## Create .venv with everything needed; does nothing when it is up to date

$(READY): pyproject.toml constraints.txt
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	    echo "Tidemap needs Python 3.11 or newer; '$(PYTHON)' is $$("$(PYTHON)" -c 'import platform; \
	        print("Python " + platform.python_version())' 2>/dev/null || echo 'no Python that runs')." >&2; \
	    echo "Name another one, for example: make $(or $(MAKECMDGOALS),setup) PYTHON=python3.12" >&2; exit 1; }
	@echo "Setting up .venv (a minute or two the first time) ..."
	@if [ -e .venv/folder ] && [ "$$(cat .venv/folder)" != "$(CURDIR)" ]; then rm -rf .venv; fi
	@"$(PYTHON)" -m venv .venv || { \
	    echo "Creating .venv failed. On Debian or Ubuntu: apt-get install python3-venv" >&2; exit 1; }
	@.venv/bin/python -m pip install -qq --disable-pip-version-check -c constraints.txt -e '.[server,dev]'
	@printf '%s\n' "$(CURDIR)" > .venv/folder
	@touch $(READY)
	@echo "Set up."

run: setup ## Start the server with a live demo world; HOST=, PORT= and DATA= may be given
	@exec .venv/bin/python -m tidemap.cli serve --host "$(HOST)" --port "$(PORT)" --data "$(DATA)" --demo

test: lint browser ros ## Check, then run every test, with PostgreSQL and a real browser
	@.venv/bin/python -m pytest $(PYTEST)

check: lint ## Check format, lint, types, layers and the examples in docstrings
	@.venv/bin/python -m pytest --quiet app

lint: setup
	@.venv/bin/python -m ruff format --check --quiet . || { \
	    echo "Fix the format with: .venv/bin/ruff format ." >&2; exit 1; }
	@.venv/bin/python -m ruff check --quiet .
	@.venv/bin/python -m mypy --no-error-summary
	@.venv/bin/oxlint --quiet --deny-warnings --ignore-pattern vendor web/tidemap_web/pages/static
	@DENO_DIR=.venv/deno DENO_NO_UPDATE_CHECK=1 .venv/bin/deno check --quiet --no-remote --no-npm --config web/deno.json \
	    web/types.d.ts $$(find web/tidemap_web/pages/static -name "*.js" -not -path "*/vendor/*")
	@.venv/bin/lint-imports --no-logo

bench: setup ## Measure every figure against its floor: one JSON line each
	@.venv/bin/python -m tests.bench

paper: setup ## Make every figure and table of docs/method.md again, from ../shared/data; some minutes
	@.venv/bin/python -m docs.paper

screenshots: setup browser ## Make the pictures of docs/viewer.md again, from the demo; some minutes
	@.venv/bin/python -m docs.make_screenshots

dist: setup ## Build the wheel and the source distribution into dist/ and check both
	@rm -rf dist
	@.venv/bin/python -m pip install -qq --disable-pip-version-check -c constraints.txt -e '.[release]'
	@.venv/bin/python -m hatchling build -d dist
	@.venv/bin/python -m twine check --strict dist/*
	@.venv/bin/python -m pytest --quiet tests/e2e/test_wheel.py

browser:
	@sh tests/support/browser.sh
	@sh tests/support/programs.sh

ros: setup
	@sh tests/support/ros2/environment.sh

clean: ## Remove .venv and everything generated; the data stay
	@rm -rf .venv dist build .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
