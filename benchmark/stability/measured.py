# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measured FRFs of links: noise, faults of the measurement, and too few lines."""

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from benchmark.report import table
from benchmark.stability.static_limit import ALPHA3, PLACES, component_frfs, linkage, picture_of
from linkage_vibration.drawing.palette import COLOURS, GREY, INK
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.fbs import component_frf, couple_frfs
from linkage_vibration.mechanics.identification import identify
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.regularisation import (
    MeasuredFrfs,
    noise_gain,
    noise_level,
    receptances,
    regularise,
    rigid_motions,
)
from linkage_vibration.mechanics.response import oscillators
from linkage_vibration.readers.frfs import read_frfs

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

TITLE = "Measured FRFs"

_BAND = (0.0, 200.0)  # Hz
_LINES: FloatArray = np.linspace(0.1, 200.0, 2000)
_FAR: FloatArray = np.linspace(0.1, 500.0, 5000)
_CUTS = (1e-7, 1e-6, 1e-5, 1e-4)  # of the largest singular value of B H B^T


@dataclass(frozen=True)
class _Bench:
    """The paper's linkage at 140 deg with one measured link."""

    solution: Solution
    lines: FloatArray
    at: int
    blocks: list[ComplexArray]
    rows: FloatArray
    exact: ComplexArray

    @property
    def link(self) -> Component:
        """The link that is measured."""
        component = self.solution.model.components[self.at]
        assert isinstance(component, Component)
        return component

    def regularised(self, frf: ComplexArray) -> MeasuredFrfs:
        """Regularise FRFs of the link."""
        points = self.solution.model.mechanism.local_points(self.link.name)
        motions = rigid_motions(self.link.dofs, list(points.items()))
        return regularise(self.link.dofs, self.lines, frf, motions)

    def couple(self, frf: ComplexArray, b: FloatArray | None = None) -> ComplexArray:
        """Return the receptances of PLACES to a force at the first."""
        b = self.solution.joining.compatibility if b is None else b
        return couple_frfs(receptances(self._put(frf)), b, self.rows, self.rows[:1])

    def truncated(self, frf: ComplexArray, cut: float) -> ComplexArray:
        """Couple by a truncated SVD of B H B^T."""
        b = self.solution.joining.compatibility
        h = np.array(
            [block_diag(*lines) for lines in zip(*receptances(self._put(frf)), strict=True)]
        )
        joints = np.linalg.pinv(b @ h @ b.T, rcond=cut)
        return np.asarray(self.rows @ (h - h @ b.T @ joints @ b @ h) @ self.rows[:1].T)

    def share(self, part: MeasuredFrfs) -> float:
        """Noise gain of the drive point, L2 over the band."""
        size = np.abs(self.exact[:, 0, 0])
        return float(np.linalg.norm(self.gain(part) * size) / np.linalg.norm(size))

    def gain(self, part: MeasuredFrfs) -> FloatArray:
        """Noise gain of the drive point, (n_freq,)."""
        b, row = self.solution.joining.compatibility, self.rows[:1]
        return noise_gain(self._put(part), b, row, row)[:, 0, 0]

    def error(self, coupled: ComplexArray) -> float:
        """Relative L2 error of the drive-point receptance in the band."""
        band = self.lines <= _BAND[1]
        rest = np.linalg.norm((coupled - self.exact)[band, 0])
        return float(rest / np.linalg.norm(self.exact[band, 0]))

    def _put(self, part: ComplexArray | MeasuredFrfs) -> list[ComplexArray | MeasuredFrfs]:
        return [part if k == self.at else block for k, block in enumerate(self.blocks)]


def section(pictures: Path) -> str:
    """Damage the FRFs of one link in several ways, couple them by each method, and report."""
    model = linkage()
    rod, lower = _bench(model, "lift_rod"), _bench(model, "lower_link")
    rows = [_noise(case, share) for case in (rod, lower) for share in (1e-3, 1e-2, 0.1)]
    _draw(lower, pictures)
    columns = [
        "link, noise",
        "found",
        "raw",
        "SVD cut",
        "ours",
        "modes [Hz]",
        "gain, raw",
        "gain, ours",
    ]
    truth = ", ".join(f"{frequency:.4g}" for frequency in rod.solution.natural_frequencies[:3])
    return f"""\
A free link moves far more than it deforms. At mode 1, noise of 0.1 % in the receptances of the lift
rod is {_drowned(rod):.0f} times as large as its flexibility along its axis. The table is for the
paper's linkage at 140 deg, with 2000 lines up to 200 Hz, and with one link measured with relative
noise. It shows the error of the drive point's FRF (L2 norm over the band) from the raw FRFs, with
the best of four truncations of the SVD of B H B^T, and with ours; the modes that ours finds (exact:
{truth} Hz); and the gain of the noise (L2 norm over the band):

{table(columns, rows)}

Truncating the singular values of B H B^T does not help, whatever the threshold: the small ones
belong to the stiff directions of the joints, which then come apart. Ours separates noise where it
can be identified: under self-equilibrated forces H N (N^T R = 0, R the rigid motions), a free link
responds only with its flexibility. This flexibility is fitted over all lines, with as many poles
and residual terms as the noise justifies (Bayesian information criterion). Without noise, the fit
adds an error of {_own(rod, lower):.0e}. The noise gain (`regularisation.noise_gain`) is known in
advance: to first order, it is the relative error of the coupled FRF divided by that of the measured
ones. Where noise times gain exceeds one half, coupling is rejected.

Faults that averaging cannot remove are rejected:

{_faults(model)}

A fault below 3 % of the FRFs cannot be distinguished from a sound measurement:
{_unseen(lower)}

Poles below 10 Hz are fitted together with those above: {_low(model)}

Tests: `test/mechanics/test_regularisation.py::test_noise_in_a_link`,
`::test_truncating_the_interface_flexibility_is_no_cure`, `::test_gain_of_raw_frfs` (Monte Carlo),
`::test_gain_of_regularised_frfs`, `::test_lines_that_show_no_flexibility`,
`::test_faults_are_refused`, `test/test_remedies.py::test_remedy`,
`test/mechanics/test_identification.py::test_lines_short_of_the_band`,
`::test_lines_too_coarse_for_light_damping`, `::test_modes_below_ten_hertz`,
`::test_modes_that_noise_hides_are_reported`.

![Drive-point FRF from a noisy link, and the gain of its noise](stability/measured.png)
"""


def _bench(model: LinkageModel, name: str, lines: FloatArray = _LINES) -> _Bench:
    solution = model.solve(ALPHA3)
    return _Bench(
        solution,
        lines,
        [c.name for c in model.components].index(name),
        component_frfs(model, lines),
        model.rows(PLACES, solution.configuration),
        solution.frf(PLACES, PLACES[:1]).frf(lines),
    )


def _noisy(frf: ComplexArray, share: float) -> ComplexArray:
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(frf.shape) + 1j * rng.standard_normal(frf.shape)
    return np.asarray(frf * (1.0 + share * noise / math.sqrt(2.0)))


def _noise(case: _Bench, share: float) -> list[str]:
    """Return a row of the table of noise."""
    clean = case.blocks[case.at]
    frf = _noisy(clean, share)
    part = case.regularised(frf)
    coupled = case.couple(part.frf)
    cut = min(case.error(case.truncated(frf, cut)) for cut in _CUTS)
    try:
        result = identify(case.lines, coupled, _BAND).omega / (2.0 * math.pi)
        modes = ", ".join(f"{frequency:.4g}" for frequency in result)
    except LinkageVibrationError:
        modes = "refused"
    return [
        f"{case.link.name}, {100.0 * share:g} %",
        f"{100.0 * noise_level(case.lines, frf):.2g} %",
        f"{case.error(case.couple(frf)):.2g}",
        f"{cut:.2g}",
        f"{case.error(coupled):.2g}",
        modes,
        f"{case.share(_as_measured(clean)):.2g}",
        f"{case.share(MeasuredFrfs(clean, part.kept, part.leverage)):.2g}",
    ]


def _as_measured(frf: ComplexArray) -> MeasuredFrfs:
    """Return receptances, (n_freq, n, n), that nothing has smoothed."""
    return MeasuredFrfs((frf + frf.swapaxes(1, 2)) / 2.0, np.eye(frf.shape[1]), np.zeros(len(frf)))


def _drowned(case: _Bench) -> float:
    """Return noise of 0.1 % at mode 1 over the flexibility of a bar between its ends."""
    line = int(np.abs(case.lines - case.solution.natural_frequencies[0]).argmin())
    frf = case.blocks[case.at][line]
    ends = [k for k, dof in enumerate(case.link.dofs) if dof.direction == "x"]
    pull = np.zeros(len(frf))
    pull[ends] = 1.0, -1.0
    return float(1e-3 * np.abs(frf[ends[0], ends[0]]) / np.abs(pull @ frf @ pull))


def _own(*cases: _Bench) -> float:
    """Return the error that regularisation brings to FRFs without noise."""
    return max(
        case.error(case.couple(case.regularised(case.blocks[case.at]).frf)) for case in cases
    )


def _refusal(act: Callable[[], object]) -> str:
    try:
        act()
    except LinkageVibrationError as error:
        return f'refused: "{error}"'
    raise AssertionError("a fault of the measurement was not refused")


def _drifted(case: _Bench, share: float) -> ComplexArray:
    """Return FRFs whose last two columns were measured when the link's poles were lower."""
    c, frf = case.link, case.blocks[case.at].copy()
    soft = (1.0 - share) ** 2 * c.stiffness
    frf[:, :, -2:] = component_frf(c.mass, soft, c.damping, len(c.dofs), case.lines)[:, :, -2:]
    return frf


def _faults(model: LinkageModel) -> str:
    """Return the list of faults, with what becomes of each plainly, and ours."""
    case = _bench(model, "lower_link", _FAR)
    clean = case.blocks[case.at]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lower.npz"

        def read(frf: ComplexArray, keep: int = 6) -> str:
            """Return the refusal of a file, without the folder."""
            dofs = np.array([str(dof) for dof in case.link.dofs])[:keep]
            np.savez(path, frequencies=case.lines, frf=2.0 * frf[:, :keep, :keep], dofs=dofs)
            link = next(each for each in model.mechanism.links if each.name == case.link.name)
            message = _refusal(lambda: link.positions(case.link.dofs, read_frfs(path).dofs))
            return message.replace(f"{folder}/", "")

        unequal = clean.copy()
        unequal[:, 1, 5] *= 1.3
        missing = read(clean, 5)
        not_reciprocal = read(unequal)
    gain = clean.copy()
    gain[:, 5] *= 1.1
    drift = _drifted(case, 0.01)
    b = case.solution.joining.compatibility
    labels = case.solution.joining.labels
    held = [not (label.startswith("pin E1") and label.endswith("z")) for label in labels]
    assert sum(held) == len(labels) - 1
    modes = case.solution.natural_frequencies[:3]
    short, reach = case.lines[case.lines <= 150.0], case.exact[case.lines <= 150.0]
    seen = identify(short, reach, (0.0, 150.0)).omega / (2.0 * math.pi)
    shapes = case.solution.participation(PLACES)[:, :8]
    sharp = [
        oscillators(case.solution.modes.omega[:8], np.full(8, 2e-4), shape * shapes[0])
        for shape in shapes
    ]
    light = np.concatenate([each.frf(_LINES)[:, 0] for each in sharp], axis=1)[:, :, None]
    peak = sharp[0].peak(_BAND)
    faults = {
        "**A DoF is missing**, E1 z": [
            f"joint left open: error {case.error(case.couple(clean, b[held])):.2g}",
            missing,
        ],
        "**Drift**: poles 1 % lower in 2 of 6 columns": [
            f"error {case.error(case.couple(_mean(drift))):.2g}",
            _refusal(lambda: case.regularised(drift)),
        ],
        "**Not reciprocal**: one H_ij 30 % above H_ji": [
            f"error {case.error(case.couple(_mean(unequal))):.2g}",
            not_reciprocal,
        ],
        "**A sensor** that shows 10 % too much": [
            f"error {case.error(case.couple(_mean(gain))):.2g}",
            _refusal(lambda: case.regularised(gain)),
        ],
        "**Lines to 150 Hz**, band to 200 Hz": [
            f"{len(seen)} modes of {len(modes)}, that at {modes[2]:.4g} Hz is missing",
            _refusal(lambda: identify(short, reach, _BAND)),
        ],
        "**Lines every 0.1 Hz**, damping ratios of 0.02 %": [
            f"the highest line is {np.abs(light[:, 0, 0]).max() / peak.magnitude:.2g} of the peak",
            _refusal(lambda: identify(_LINES, light, _BAND)),
        ],
    }
    return "\n".join(
        f"- {fault}. Plain: {plain}. Ours: {ours}" for fault, (plain, ours) in faults.items()
    )


def _mean(frf: ComplexArray) -> ComplexArray:
    """Return what reciprocity makes of FRFs."""
    return np.asarray((frf + frf.swapaxes(1, 2)) / 2.0)


def _unseen(case: _Bench) -> str:
    """Tell what faults do that are too small to be refused."""
    frf = case.blocks[case.at].copy()
    frf[:, 5] *= 1.02
    words = []
    small = {
        "a sensor that shows 2 % too much": frf,
        "columns whose poles, above the lines, are 1 % apart": _drifted(case, 0.01),
    }
    for name, faulty in small.items():
        part = case.regularised(_noisy(faulty, 1e-3))
        coupled = case.couple(part.frf)
        first = identify(case.lines, coupled, _BAND).omega[0] / (2.0 * math.pi)
        off = abs(first / case.solution.natural_frequencies[0] - 1.0)
        words.append(f"{name}: error {case.error(coupled):.2g}, mode 1 off by {100.0 * off:.1g} %")
    return ";\n".join(words) + "."


def _low(model: LinkageModel) -> str:
    """Tell how far mode 1 is off over the stroke, identified with 1 % of noise."""
    worst, lowest = 0.0, math.inf
    for alpha3 in np.radians(np.linspace(90.0, 180.0, 10)):
        solution = model.solve(float(alpha3))
        frf = _noisy(solution.frf(PLACES, PLACES[:1]).frf(_LINES), 1e-2)
        result = identify(_LINES, frf, _BAND).omega[0] / (2.0 * math.pi)
        worst = max(worst, abs(result / solution.natural_frequencies[0] - 1.0))
        lowest = min(lowest, result)
    return f"""mode 1, from {lowest:.2g} Hz upwards,
is accurate to {worst:.0e} over the stroke with noise of 1 % of the assembly's FRFs."""


def _draw(case: _Bench, pictures: Path) -> None:
    """Draw the drive point with 1 % of noise in a link, and the gains."""
    clean = case.blocks[case.at]
    frf = _noisy(clean, 1e-2)
    part = case.regularised(frf)
    figure = picture_of("Drive-point FRF with noise of 1 % in the lower link's FRFs", 8, 5.8)
    above, below = figure.subplots(2, sharex=True)
    lines = case.lines
    styles: list[tuple[ComplexArray, str, float, str]] = [
        (case.couple(frf), COLOURS[4], 0.5, "LM-FBS of raw FRFs"),
        (case.truncated(frf, 1e-6), COLOURS[3], 0.5, "SVD of B H B$^T$ cut at 1e-6"),
        (case.exact, INK, 3.0, "truth"),
        (case.couple(part.frf), COLOURS[2], 1.2, "ours"),
    ]
    for coupled, colour, width, label in styles:
        above.loglog(lines, np.abs(coupled[:, 0, 0]), color=colour, lw=width, label=label)
    raw = case.gain(_as_measured(clean))
    below.loglog(lines, raw, color=COLOURS[1], lw=1.2, label="gain, raw")
    ours = case.gain(MeasuredFrfs(clean, part.kept, part.leverage))
    below.loglog(lines, ours, color=COLOURS[2], ls="--", lw=1.2, label="gain, ours")
    below.axhline(100.0, color=GREY, lw=1.0)
    below.annotate(
        "above: 1 % of noise drowns the FRF", (0.11, 130.0), color=GREY, fontsize=8, va="bottom"
    )
    above.set(ylabel="|H| [m/N]", ylim=(1e-10, 1e-1))
    below.set(xlabel="frequency [Hz]", ylabel="noise gain [1]", xlim=(0.1, 200.0))
    for ax in (above, below):
        ax.grid(color="#dddddd", linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    figure.savefig(pictures / "measured.png")
