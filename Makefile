# Each target sets up what it needs, then runs; a second call starts at once.
#   make demo PYTHON=python3.12     another Python
#   make setup PIP_ARGS="..."       more options for pip, such as where torch's CPU build is

SHELL := /bin/bash
MAKEFLAGS += --no-print-directory
.DEFAULT_GOAL := help
.PHONY: help setup llvm open3d browser demo test test-all pytest lint docs bench scaling cluster clean distclean

# Tests that `make test` leaves to `make test-all`: whole rooms, every rule, faults of machines.
TESTS ?= -m 'not slow'

VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
# The rules of the workflow call `fipt` by name.
export PATH := $(CURDIR)/$(BIN):$(PATH)

# Tested Pythons first, newest first; a newer one is taken only where there is no other.
PYTHONS := $(or $(PYTHON),python3.13 python3.12 python3.11 python3.14 python3)
# LLVM 16 or newer compiles the ray tracer's kernels; 19 is the one tested.
LLVM_PACKAGES := libllvm19 libllvm20 libllvm21 libllvm18 libllvm17 libllvm16

# Libraries that open3d's wheel expects of the system; without them all but `fipt mesh` works.
OPEN3D_PACKAGES := libgl1 libegl1 libx11-6 libusb-1.0-0

CAN_RUN := -c 'import sys; sys.exit(sys.version_info < (3, 11))'
LLVM_USABLE := -c 'import sys; from fipt.render.variant import find_llvm; \
  library = find_llvm(); sys.exit(not (library and library.usable))'

# $(call apt-install,packages,what for): install the first package that exists, as root or with
# password-less sudo; else say in one line what to run.
define apt-install
  say() { echo "fipt: $(2): run 'sudo apt-get update && sudo apt-get install $(firstword $(1))', then make again" >&2; exit 1; }; \
  command -v apt-get >/dev/null || { echo "fipt: $(2): install it with this system's package manager, then make again" >&2; exit 1; }; \
  if [ "$$(id -u)" = 0 ]; then root=; elif sudo -n true 2>/dev/null; then root="sudo -n"; else say; fi; \
  newest() { for p in $(1); do apt-cache policy $$p 2>/dev/null | grep -q 'Candidate: [0-9]' && echo $$p && return; done; }; \
  get() { p=$$(newest); [ -n "$$p" ] && echo "fipt: installing $$p" && \
    $$root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $$p >/dev/null; }; \
  get || { $$root apt-get update -qq && get; } || say
endef

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(INSTALLED) llvm open3d  ## .venv, the pinned packages, fipt itself, LLVM, libraries of open3d

$(BIN)/python:
	@for python in $(PYTHONS); do \
	  if "$$python" $(CAN_RUN) 2>/dev/null; then found=$$python; break; fi; \
	done; \
	if [ -z "$$found" ]; then \
	  echo "fipt: Python 3.11 or newer is needed (tried: $(PYTHONS)); install it, or name it with PYTHON=" >&2; exit 1; \
	fi; \
	if ! "$$found" -c 'import ensurepip' 2>/dev/null; then \
	  venv=$$("$$found" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
	  $(call apt-install,$$venv python3-venv,this Python lacks venv); \
	fi; \
	echo "fipt: creating $(VENV) with $$("$$found" --version)"; \
	"$$found" -m venv $(VENV)

$(INSTALLED): requirements.lock pyproject.toml | $(BIN)/python
	@echo "fipt: installing the packages of requirements.lock (minutes the first time)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_ARGS) -r requirements.lock
	@# The lock holds setuptools, so that building needs no second download; nothing else is resolved.
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps -e .
	@touch $@

llvm: | $(BIN)/python
	@$(BIN)/python $(LLVM_USABLE) 2>/dev/null || { $(call apt-install,$(LLVM_PACKAGES),LLVM 16 or newer is missing); }
	@$(BIN)/python $(LLVM_USABLE) 2>/dev/null || { echo "fipt: LLVM is still not usable: see $(BIN)/fipt doctor" >&2; exit 1; }

open3d: $(INSTALLED)
	@$(BIN)/python -c 'import open3d' 2>/dev/null || for library in $(OPEN3D_PACKAGES); do \
	  ( $(call apt-install,$$library,open3d cannot be imported, which makes meshes of photographs) ) || true; \
	done

browser:  ## Chromium, for the tests of the report
	@command -v chromium chromium-browser google-chrome >/dev/null || { $(call apt-install,chromium,Chromium is missing); }

demo: setup  ## the demo room, from nothing to its report (5 to 12 minutes on 2 cores)
	@$(BIN)/fipt run demo
	@echo "fipt: open $(CURDIR)/results/demo/report.html"

test: setup  ## the checks and most tests
	@# The checks run beside the tests: most of their time is that of one program on one processor.
	@$(MAKE) -j2 lint pytest || { echo "fipt: the checks or the tests failed: see above" >&2; exit 1; }

test-all:  ## the checks and all tests, as CI runs them (20 minutes on 2 cores)
	@$(MAKE) test TESTS=

pytest: $(INSTALLED)
	@# Files of tests go to two processes; tests of a file stay together, since they share fixtures. Their order is that
	@# of tests/conftest.py, long ones first.
	@$(BIN)/python -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder $(TESTS)

lint: $(INSTALLED)  ## formatting, static checks, the workflow's linter, import directions, types
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/codespell
	@$(BIN)/snakefmt --check Snakefile fipt/workflow
	@$(BIN)/snakemake --lint
	@$(BIN)/lint-imports
	@$(BIN)/basedpyright --level error

docs: $(INSTALLED)  ## the documentation as a site, site/index.html; a dead link or an unknown name is an error
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo "fipt: open $(CURDIR)/site/index.html"

bench: setup  ## speed and quality against the reference methods
	@$(BIN)/python -m benchmarks

scaling: setup  ## how time and memory grow with views, resolution and triangles (10 minutes on 2 cores)
	@$(BIN)/python -m benchmarks.scaling

cluster: setup  ## three tiny rooms on a SLURM cluster of this machine, disturbed; the bytes are those of one machine
	@command -v slurmctld /usr/sbin/slurmctld >/dev/null || { $(call apt-install,slurm-wlm,SLURM is missing); }
	@command -v munged /usr/sbin/munged >/dev/null || { $(call apt-install,munge,munge is missing); }
	@$(BIN)/python -c 'import snakemake_executor_plugin_slurm' 2>/dev/null || \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_ARGS) 'snakemake-executor-plugin-slurm>=2.8,<3'
	@$(BIN)/python -m tests.cluster

clean:  ## remove caches and build leftovers; results and .venv stay
	rm -rf build dist site *.egg-info .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -exec rm -rf {} +

distclean: clean  ## remove .venv and the workflow's own records as well
	rm -rf $(VENV) .snakemake
