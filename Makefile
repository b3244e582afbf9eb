# `make` lists the commands. Each installs what it needs first, and nothing twice.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

STUDY ?= paper
RAYS ?= 1000000
VENV := .venv
PYTHON := $(VENV)/bin/python
BENCH := $(VENV)/bin/csgbench
SOURCES := $(filter-out tracers/bench/%,$(wildcard tracers/*.?pp tracers/*/*.?pp tracers/schemes/schemes.def)) CMakeLists.txt pyproject.toml

.PHONY: help setup sweep bench test check conformance accuracy stability scale bench-micro reference report publish paper lock format clean

help:  ## list the commands
	@grep -hE '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | expand -t 14

setup: $(VENV)/.built  ## install packages, make .venv, build

sweep: setup  ## run a study (STUDY=paper or grid), then its tables and plots
	@$(BENCH) sweep $(STUDY)

bench: setup  ## our schemes beside POV-Ray and Embree, one thread and all: twenty to forty minutes
	@$(BENCH) sweep bench

test: setup  ## the tests, conformance of all schemes included
	@$(PYTHON) -m pytest

check: setup  ## style and lint
	@$(VENV)/bin/clang-format --dry-run --Werror $$(git ls-files 'tracers/*.?pp')
	@$(VENV)/bin/ruff check harness generators tracers
	@$(VENV)/bin/ruff format --check harness generators tracers

conformance: setup  ## all exact schemes against naive, RAYS=1000000 a family and scheme
	@$(PYTHON) -m pytest tracers/tests/test_conformance.py tracers/tests/test_conformance_scenes.py --rays $(RAYS)

accuracy: setup  ## speed for accuracy, against the oracle: half an hour
	@$(BENCH) accuracy

stability: setup  ## numerical stability at the extremes, RAYS=1000000 a row: an hour
	@$(BENCH) stability --rays $(RAYS)

scale: setup  ## growth with the model, 10³ to 10⁶ halfspaces: half an hour
	@$(BENCH) scale

bench-micro: setup  ## kernels, structures and schemes one by one, by Google Benchmark: two minutes
	@./packages.sh bench
	@export PATH="$(CURDIR)/$(VENV)/bin:$$PATH"; \
	  cmake -S . -B build/micro -G Ninja -DMICRO=ON -DPython_EXECUTABLE="$(CURDIR)/$(PYTHON)" >/dev/null; \
	  cmake --build build/micro --target micro -- --quiet; touch build/micro/micro
	@$(BENCH) micro

reference: setup  ## render POV-Ray's pictures and compare ours with them
	@$(BENCH) reference

report: setup  ## tables and plots again from the trials recorded so far
	@$(BENCH) tables && $(BENCH) plots

publish: setup  ## copy tables, plots and pictures to results/published, which the README shows
	@$(BENCH) tables --publish && $(BENCH) plots --publish
	@mkdir -p results/published/pictures
	@for model in ball ngk ngkcut; do $(BENCH) trace $$model -o results/published/pictures/$$model.png >/dev/null; done

paper: setup  ## build paper/paper.pdf from paper/generated
	@./packages.sh paper
	@$(BENCH) tables && $(BENCH) plots
	@cd paper && for pass in 1 2; do pdflatex -interaction=nonstopmode -halt-on-error paper.tex >/dev/null || { tail -20 paper.log; exit 1; }; done
	@echo "paper/paper.pdf"

lock: setup  ## requirements.in -> requirements.txt with hashes
	@$(PYTHON) -m venv build/lock && build/lock/bin/pip -q install uv
	@build/lock/bin/uv pip compile --upgrade --generate-hashes --no-emit-index-url --no-header -q requirements.in -o requirements.txt

format: setup  ## format C++ and Python
	@$(VENV)/bin/clang-format -i $$(git ls-files 'tracers/*.?pp')
	@$(VENV)/bin/ruff check --fix -q harness generators tracers && $(VENV)/bin/ruff format -q harness generators tracers

clean:  ## remove what was built and measured (results/published stays)
	rm -rf $(VENV) build
	find results -mindepth 1 -maxdepth 1 ! -name published -exec rm -rf {} +

# Set-up, each step once: packages -> .venv -> the extension module.
$(VENV)/.packages: packages.apt packages.sh
	@./packages.sh run
	@mkdir -p $(VENV) && touch $@

$(VENV)/.python: requirements.txt $(VENV)/.packages
	@echo "Making .venv from requirements.txt …"
	@/usr/bin/python3 -m venv $(VENV)
	@$(PYTHON) -m pip install -q --disable-pip-version-check --require-hashes -r requirements.txt
	@touch $@

$(VENV)/.built: $(SOURCES) $(VENV)/.python
	@echo "Building the tracers …"
	@PATH="$(CURDIR)/$(VENV)/bin:$$PATH" $(PYTHON) -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@
