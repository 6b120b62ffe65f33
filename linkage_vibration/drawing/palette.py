# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The colours of every picture and page."""

# The palette of Okabe and Ito, which colour-blind readers can distinguish.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#56B4E9", "#E69F00")
INK, GREY = "#222222", "#6b6b6b"
PEAK = "#AA4499"  # the FRF peak, and mode 6
ABOVE, ABOVE_SHADE = "#CC3311", "#f8ddd6"  # what exceeds its limit
GAP_SHADE, INVALID_SHADE, TOGGLE_SHADE = "#e4e4e4", "#f9e08b", "#d9e6f2"
FAINT = 0.02  # of the limit: an order whose load ratio stays below this share is drawn in grey


def mode_colours(n_modes: int) -> list[str]:
    """Return one colour for each mode; they repeat when there are more modes than colours."""
    colours = *COLOURS, PEAK, "#332288", "#999933"
    return [colours[mode % len(colours)] for mode in range(n_modes)]
