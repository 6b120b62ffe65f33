# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads mechanisms, excitations, and components (matrices, FRFs) from files."""
