# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Where the plain methods fail, and what ours do there: the sections of docs/stability.md."""
