# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Cases in which common methods fail: each module writes one section of results/stability.md."""
