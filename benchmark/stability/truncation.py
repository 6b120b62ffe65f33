# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Few modes in the sum or per link: errors at antiresonances and of the static limit."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.report import table
from benchmark.stability.static_limit import ALPHA3, PLACES, linkage, picture_of
from linkage_vibration.drawing.palette import COLOURS, GREY, INK
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import PoleResidue

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

TITLE = "Truncation: antiresonances and the static limit"

_BAND = (0.0, 200.0)  # Hz
_LINES: FloatArray = np.linspace(*_BAND, 4001)
_MODES = (3, 5, 10, 15)  # in the sum
_PER_LINK = (0, 1, 2, 3, 5)
_DRAWN = (PLACES.index(("E1", "x")), PLACES.index(("E2", "x")))


def section(pictures: Path) -> str:
    """Leave modes out of the sum and out of the links, with and without residual, and report."""
    model = linkage()
    solution = model.solve(ALPHA3)
    complete = solution.frf(PLACES, PLACES)
    exact = complete.frf(_LINES)
    ours = solution.frf(PLACES, PLACES, band=_BAND).frf(_LINES)
    rows = [
        [
            f"{n} of {len(complete.decay)}",
            *_texts([_truncated(complete, n, k) for k in range(3)], exact),
        ]
        for n in _MODES
    ]
    whole = LinkageModel(model.mechanism, reduced=False).solve(ALPHA3).frf(PLACES, PLACES)
    unreduced = whole.frf(_LINES)
    links = [[f"{n}", *_of_links(model, n, unreduced)] for n in (*_PER_LINK, 20)]
    _draw(exact, [_truncated(complete, 3, k) for k in range(2)], ours, pictures)
    return f"""\
The natural frequencies of the modes that are kept remain right. The errors are where modes cancel
each other. The table is for the paper's linkage at 140 deg and the 16 FRFs between four places, 0
to 200 Hz. It shows the largest relative error at any line (large ones are at antiresonances) and at
0 Hz, when modes are left out of the sum: with no replacement, with their static flexibility, and
also with the next term (together the sum of r / k + (w^2 - i w c) r / k^2):

{table(["modes", "none: worst", "static", "second order", "none: at 0 Hz", "static at 0 Hz"], rows)}

The band contains only three modes, and mode 4 is at 207 Hz, too near for a static residual. Ours
keeps the modes up to 1.3 times the band, and represents all others by four fixed poles and a static
residual (`Solution.frf(..., band)`). Its largest error is {_worst(ours, exact):.0e}, and
{_worst(ours[:1], exact[:1]):.0e} at 0 Hz.

The next table compares the number of fixed-interface modes per link (Craig-Bampton) with all DoFs
of the beams. Constraint modes contain the static flexibility, so 0 Hz is exact even without any
fixed-interface mode:

{table(["modes per link", "worst", "norm of all", "at 0 Hz"], links)}

Tests: `test/mechanics/test_model.py::test_a_band_keeps_antiresonances_and_the_static_limit`,
`test/mechanics/test_reduction.py::test_statics_on_the_interface_are_exact`,
`::test_frequencies_fall_from_above`.

![One FRF with three modes: without residual, with it, and ours](stability/truncation.png)
"""


def _truncated(complete: PoleResidue, n: int, order: int) -> ComplexArray:
    """Return the sum of the first modes, (n_freq, n_out, n_in), with the series of the others."""
    k, c, r = complete.stiffness, complete.decay, complete.residues
    w = 2.0 * math.pi * _LINES[:, np.newaxis]
    frf = np.einsum("oir,fr->foi", r[:, :, :n], 1.0 / (k[:n] - w**2 + 1j * w * c[:n]))
    k, c, r = k[n:], c[n:], r[:, :, n:]
    if order >= 1:
        frf = frf + (r / k).sum(axis=2)
    if order >= 2:
        frf = frf + np.einsum("oir,fr->foi", r / k**2, w**2 - 1j * w * c)
    return np.asarray(frf)


def _worst(result: ComplexArray, exact: ComplexArray) -> float:
    return float((np.abs(result - exact) / np.abs(exact)).max())


def _texts(result: list[ComplexArray], exact: ComplexArray) -> list[str]:
    """Return the largest error of each, then the errors of the first two at 0 Hz."""
    return [f"{_worst(frf, exact):.1g}" for frf in result] + _at_zero(result[:2], exact)


def _at_zero(result: list[ComplexArray], exact: ComplexArray) -> list[str]:
    return [f"{_worst(frf[:1], exact[:1]):.0e}" for frf in result]


def _of_links(model: LinkageModel, n: int, exact: ComplexArray) -> list[str]:
    links = tuple(replace(link, modes=n) for link in model.mechanism.links)
    few = LinkageModel(replace(model.mechanism, links=links), kinematics=model.kinematics)
    receptances = few.solve(ALPHA3).frf(PLACES, PLACES).frf(_LINES)
    norm = np.linalg.norm(receptances - exact) / np.linalg.norm(exact)
    return [f"{_worst(receptances, exact):.1g}", f"{norm:.0e}", *_at_zero([receptances], exact)]


def _draw(
    exact: ComplexArray, sums: list[ComplexArray], ours: ComplexArray, pictures: Path
) -> None:
    """Draw one FRF with different numbers of modes."""
    out, into = _DRAWN
    figure = picture_of(
        "Response of E1 in x to a force at E2 in x, modes 1 to 3 in the sum", 8, 5.6
    )
    above, below = figure.subplots(2, sharex=True)
    above.semilogy(_LINES, np.abs(exact[:, out, into]), color=INK, lw=2.5, label="every mode")
    styles = [
        (sums[0], COLOURS[1], "-", "3 modes, no residual"),
        (sums[1], COLOURS[4], "--", "3 modes and static residual"),
        (ours, COLOURS[2], "-", "ours, for this band"),
    ]
    for frf, colour, dashes, label in styles:
        value, truth = frf[:, out, into], exact[:, out, into]
        above.semilogy(_LINES, np.abs(value), color=colour, ls=dashes, lw=1.3, label=label)
        error = np.maximum(np.abs(value - truth) / np.abs(truth), 1e-9)
        below.semilogy(_LINES, error, color=colour, ls=dashes, lw=1.3)
    below.axhline(1.0, color=GREY, lw=1.0)
    above.set(ylabel="|H| [m/N]")
    below.set(xlabel="frequency [Hz]", ylabel="relative error [1]", xlim=_BAND)
    for ax in (above, below):
        ax.grid(color="#dddddd", linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.savefig(pictures / "truncation.png")
