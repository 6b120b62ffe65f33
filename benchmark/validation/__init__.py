# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the package's numbers with those of independent codes; see docs/validation.md."""
