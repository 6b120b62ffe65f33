# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Looks back at logs: one as a page, two as their differences."""
