# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
#
#   make demo                        play the shipped drive to the node over DDS
#   make demo BAG=FILE JOINT=NAME    play one joint of any bag
#   make test                        lint, types and tests
#   make test ONLY=test/ros          some tests alone
#   make test VERSIONS=ubuntu-24.04  tests with the libraries that tools/ubuntu-24.04.txt names
#   make nightly                     the tests that take long, into benchmark/results/nightly.md (an hour or more)
#   make coverage                    which share of the code the tests run, into benchmark/results/coverage.md
#   make ament                       the linters of ament that PyPI has
#   make docs                        the documentation, as a site in build/docs
#   make bench                       all benchmarks, into benchmark/results (some hours)
#   make bench ONLY=latency          one of them
#
# Each target first sets an environment up if that is not done yet. PYTHON names the Python to use.
# If no ROS 2 is sourced, its wheels come from PyPI. Jazzy is the default, because PyPI has no wheels of
# Lyrical, the current long-term release; ROS_DISTRO=kilted uses Kilted.

PYTHON ?= python3
ifndef AMENT_PREFIX_PATH
ROS_DISTRO := $(or $(ROS_DISTRO),jazzy)
export ROS_DISTRO
endif
suffix := $(if $(AMENT_PREFIX_PATH),,$(filter-out -jazzy,-$(ROS_DISTRO)))$(addprefix -,$(VERSIONS))
venv := .venv$(suffix)
# The matrices are small, so BLAS threads cost more time in waiting for each other than they save.
export OPENBLAS_NUM_THREADS ?= 1
# Hundreds of processes start, and without compiled files each of them compiles all that it imports.
unexport PYTHONDONTWRITEBYTECODE
# Many tests wait for other processes, so more of them run than the machine has processors.
beside := -n 3 --dist loadfile
# Pages are built with the newest versions alone.
older := bags,plots,test
in_venv = @. $(venv)/bin/activate &&
# Tests of processes measure times, which a busy machine exceeds. A fault fails again.
once_more = { test $$? = 1 && echo "The tests that failed run once more:" && \
	python -m pytest --last-failed --last-failed-no-failures none; }

.PHONY: demo test nightly lint ament coverage docs bench setup clean

demo: setup
	$(in_venv) linkage-vibration demo $(if $(BAG),--bag "$(BAG)") $(if $(JOINT),--joint "$(JOINT)")

# Lint and types are those of the newest versions.
test: $(if $(ONLY)$(VERSIONS),setup,lint)
	$(in_venv) { python -m pytest $(if $(ONLY),$(ONLY),$(beside)) || $(once_more); }

nightly: setup
	$(in_venv) python -m pytest -m nightly -o timeout=1800 $(if $(ONLY),$(ONLY),$(beside)) \
		--junitxml=build/nightly.xml; python tools/write_nightly.py build/nightly.xml "$(ONLY)"

lint: setup
	$(in_venv) python -m ruff check .
	$(in_venv) python -m ruff format --check .
	$(in_venv) MYPY_NUM_WORKERS=2 python -m mypy

# D401 has no exception for properties, and D403 none for names such as SDynPy; the first lines of
# examples are questions (D400).
checked := linkage_vibration test benchmark tools examples launch docs setup.py
ament:
	@"$(PYTHON)" -m venv build/ament
	@build/ament/bin/pip install -qq flake8 pydocstyle ros-ament-flake8 ros-ament-lint ros-ament-pep257
	@build/ament/bin/ament_flake8 --config tools/ament_flake8.ini $(checked) > build/ament/flake8.txt || \
		{ cat build/ament/flake8.txt; false; }
	@build/ament/bin/ament_pep257 --convention numpy --add-ignore D105 D400 D401 D403 -- $(checked) \
		> build/ament/pep257.txt || { cat build/ament/pep257.txt; false; }
	@grep "No problems found" build/ament/flake8.txt build/ament/pep257.txt

coverage: setup
	$(in_venv) python -m coverage erase
	$(in_venv) python -m coverage run -m pytest $(beside)
	$(in_venv) python -m coverage combine -q
	$(in_venv) python tools/write_coverage.py

docs: setup
	$(in_venv) python -m sphinx -W --keep-going -q -c docs . build/docs
	@echo "Open build/docs/index.html in a browser."

# The benchmarks have an environment of their own, with the codes that they compare this package with.
# CalculiX, npm and Chromium come from apt; a benchmark that lacks one names it.
bench:
	@PYTHON="$(PYTHON)" sh tools/setup.sh build/bench$(suffix) bags,plots,test,uff,bench
	@. build/bench$(suffix)/bin/activate && python -m benchmark $(ONLY)

setup:
	@PYTHON="$(PYTHON)" VERSIONS="$(VERSIONS)" sh tools/setup.sh $(venv) $(if $(VERSIONS),$(older))

clean:
	rm -rf .venv .venv-* build install log *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
