# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
#
#   make demo                        play the drive that ships to the node, over DDS
#   make demo BAG=FILE JOINT=NAME    play one joint of any bag
#   make test                        lint, types and tests
#   make docs                        the documentation, as a site in build/docs
#   make bench                       comparisons with other codes, into benchmark/results
#
# Each sets .venv up first, where that is not done yet. PYTHON names the Python to use.

PYTHON ?= python3
# Matrices here are small: BLAS threads cost more in waiting for one another than they save.
export OPENBLAS_NUM_THREADS ?= 1
in_venv = @. .venv/bin/activate &&

.PHONY: demo test docs bench setup clean

demo: setup
	$(in_venv) linkage-vibration demo $(if $(BAG),--bag "$(BAG)") $(if $(JOINT),--joint "$(JOINT)")

test: setup
	$(in_venv) python -m ruff check .
	$(in_venv) python -m ruff format --check .
	$(in_venv) python -m mypy
	$(in_venv) python -m pytest

docs: setup
	$(in_venv) python -m sphinx -W --keep-going -q -c docs . build/docs
	@echo "Open build/docs/index.html in a browser."

# The peers have an environment of their own: SDynPy is under the GPL. CalculiX comes from apt.
bench: setup
	@command -v ccx > /dev/null || { echo "CalculiX is missing; run: apt-get install -y calculix-ccx"; exit 1; }
	$(in_venv) python -m venv build/bench
	build/bench/bin/pip install -qq '.[bench]'
	for name in validation.exudyn_beams validation.solid_fe validation.sdynpy_fbs calibrations \
		stability speed speed.paper_job sweep fuzz properties campbell latency \
		rebuild signals crash log_readers replay long_bag \
		review_page soak; do \
		build/bench/bin/python -m benchmark.$$name || exit 1; done

setup:
	@PYTHON="$(PYTHON)" sh tools/setup.sh

clean:
	rm -rf .venv build install log *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
