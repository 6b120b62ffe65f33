# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Helpers that several tests, or tests and benchmarks, share."""
