# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws linkages and predictions; the colours of all pictures and pages."""
