# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""From measured signals to spectra, orders, levels and natural frequencies, beside a table."""
