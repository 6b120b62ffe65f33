# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Helpers that know nothing about linkages: files, processes and the package's data."""
