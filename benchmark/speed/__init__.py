# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Error against time: every way of getting an answer, on one linkage; see docs/performance.md."""
