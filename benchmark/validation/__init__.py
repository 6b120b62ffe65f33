# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The package's numbers against codes that share nothing with it; see docs/validation.md."""
