# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measurements that take too long for the tests or need more packages than they do."""
