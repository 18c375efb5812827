# Each of these does all the set-up on a machine with python3 (venv, pip), make and apt:
#   make demo    calibrate the sample video and say where the report lies
#   make test    lint, types, layers and tests, as .ci/run does
#   make bench   measure, and write docs/benchmarks.md (12 minutes)
#   make docs    build/site from docs/, the docstrings and the command line's help
#   make wheel   build wheel and sdist, and run the README in an empty environment (8 minutes)
#   make pythons the tests on each Python from 3.11 to 3.13 that is here; RUN=wheel: make wheel on each
# Another Python: make test PYTHON=python3.12      Another place: make test VENV=/tmp/env
# Some of the tests: make test TESTS=tests/core, or TESTS='-m "not shared_data"'

PYTHON ?= python3
VENV := .venv
JOBS := 2
PYTHONS := python3.11 python3.12 python3.13
RUN := pytest

BIN := $(VENV)/bin
PYTHON_VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
# A stamp stands only while the environment is whole: every rule below takes all away before pip
# starts and puts them back at its end. Another version of Python finds no stamp and starts anew.
RUNTIME := $(VENV)/.runtime-$(PYTHON_VERSION)
DEV := $(VENV)/.dev-$(PYTHON_VERSION)
BENCH := $(VENV)/.bench-$(PYTHON_VERSION)
DOCS := $(VENV)/.docs-$(PYTHON_VERSION)

# Exact versions everywhere, in the isolated build too (newer pips read only the second variable
# there). No byte code: it is an eighth of the room, and Python writes what is used. Both hold for
# these commands alone: scene4d itself calls pip, to fetch weights.
CONSTRAINED := PIP_CONSTRAINT=constraints.txt PIP_BUILD_CONSTRAINT=constraints.txt
PIP := PIP_NO_INPUT=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore \
	$(BIN)/python -m pip --quiet
INSTALL := $(CONSTRAINED) $(PIP) install --no-compile

.PHONY: help demo test lint types layers browser pytest format bench docs wheel pythons install-size clean
.DELETE_ON_ERROR:

help:
	@sed -n 's/^# \{0,1\}//;1,9p' $(firstword $(MAKEFILE_LIST))

demo: $(RUNTIME)
	$(BIN)/scene4d demo

test: lint types layers pytest

lint: $(DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(DEV)
	$(BIN)/mypy

layers: $(DEV)
	$(BIN)/lint-imports

# Tests of the page run in Debian's Chromium. Without it they are skipped, which fails in CI.
browser:
	@command -v chromium >/dev/null || [ "$$(id -u)" != 0 ] || ! command -v apt-get >/dev/null || \
	{ echo "installing chromium (once; about 300 MB)"; apt-get -qq update && \
	DEBIAN_FRONTEND=noninteractive apt-get -qq install --no-install-recommends --yes chromium >/dev/null; }

# Where byte code is not wanted beside the sources it is kept in pytest's cache: without any, each of
# three processes compiles the libraries anew.
pytest: $(DEV) browser
	$(if $(PYTHONDONTWRITEBYTECODE),PYTHONDONTWRITEBYTECODE= \
	PYTHONPYCACHEPREFIX=$(CURDIR)/.pytest_cache/d/bytecode) $(BIN)/python -m pytest -n $(JOBS) $(TESTS)

format: $(DEV)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(BENCH)
	$(BIN)/python -m benchmarks --write

# Every warning is an error: a link that leads nowhere, a page that is on no list.
docs: $(DOCS)
	$(BIN)/python -m sphinx -W --keep-going -q -j auto docs build/site
	@echo "build/site/index.html"

wheel:
	$(PYTHON) scripts/wheel.py

# Those that are named (PYTHONS=python3.12) must be here; of the usual ones, one at least.
pythons:
	@ran=; absent=; for python in $(PYTHONS); do \
	version=$$($$python -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null) || \
	{ absent="$$absent $$python"; continue; }; \
	echo "$(RUN) on Python $$version"; \
	$(MAKE) --no-print-directory $(RUN) PYTHON=$$python VENV=$(VENV)-$$version || exit 1; ran="$$ran $$version"; \
	done; echo "$(RUN) passed on Python:$${ran:- none}; not found:$${absent:- none}"; \
	[ -n "$$ran" ] && { [ -z "$$absent" ] || [ "$(origin PYTHONS)" = file ]; }

install-size:
	$(PYTHON) benchmarks/install_size.py

clean:
	rm -rf $(VENV) $(VENV)-3.1? .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

# Python 3.11 puts setuptools into every environment; nothing here uses it.
$(RUNTIME): pyproject.toml constraints.txt
	@case "$(PYTHON_VERSION)" in 3.11|3.12|3.13) ;; \
	"") echo >&2 "$(PYTHON) does not run: install python3, or name one: make PYTHON=python3.12"; exit 1 ;; \
	*) echo >&2 "scene4d needs Python 3.11 to 3.13 and $(PYTHON) is $(PYTHON_VERSION): name another, as in make PYTHON=python3.12"; exit 1 ;; esac
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	echo >&2 "$(PYTHON) has no venv module: apt-get install python3-venv (or python$(PYTHON_VERSION)-venv)"; exit 1; }
	@echo "installing scene4d into $(VENV) (once; about 700 MB)"
	@rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV)
	@$(INSTALL) pip
	@$(PIP) --quiet uninstall --yes setuptools
	@$(INSTALL) --editable .
	@touch $@

# All stamps get one time: no group is older than RUNTIME, unless that was made anew.
$(DEV): GROUP := dev
$(BENCH): GROUP := bench
$(DOCS): GROUP := docs
$(DEV) $(BENCH) $(DOCS): $(RUNTIME)
	@echo "adding the tools of the group $(GROUP) to $(VENV)"
	@stamps=$$(ls $(RUNTIME) $(DEV) $(BENCH) $(DOCS) 2>/dev/null); rm -f $$stamps; \
	$(INSTALL) --group $(GROUP) && touch $@ && touch -r $@ $$stamps
