# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Solves the model at the angles of a table, with derivatives for Hermite interpolation."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.rates import joining_rates, row_rates, undamped_slopes
from benchmark.speed.coupled import eleven_functions
from benchmark.speed.scene import FORCE, MODES, RESPONSES, eleven
from linkage_vibration.mechanics.description import Rayleigh
from linkage_vibration.mechanics.model import LinkageModel, Solution

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

POLES = 6  # modes whose poles are in a table of FRFs; the others form its static residual
N_LIVE = 2 * MODES + 2
_STEP = 1e-4  # step relative to the peak's frequency, for finite differences


@dataclass(frozen=True, slots=True)
class Sample:
    """The values of a table at one angle.

    Attributes
    ----------
    live : ndarray, (8,)
        Natural frequencies (Hz), damping ratios, the peak's frequency (Hz) and the logarithm of its
        magnitude in m/N.
    terms : ndarray, (12 + 77,)
        Terms of the FRFs: logarithms of k, decay c, residues and static residuals (`unpacked`).
    """

    live: FloatArray
    terms: FloatArray


class Sampler:
    """A model that is solved once at each requested angle.

    Modes are in the order of their frequencies, since the first six of this linkage do not cross.

    Parameters
    ----------
    model : LinkageModel
        A linkage of beams with Rayleigh damping, without springs.
    """

    def __init__(self, model: LinkageModel) -> None:
        self.model = model
        self._values: dict[float, Sample] = {}
        self._rates: dict[float, Sample] = {}

    def at(self, alpha3: float) -> Sample:
        """Return the values at an angle."""
        if alpha3 not in self._values:
            solution = self.model.solve(alpha3)
            peak = solution.peak(self.model.mechanism.response.peak_band)
            live = [
                *solution.natural_frequencies[:MODES],
                *solution.damping_ratios[:MODES],
                peak.frequency,
                math.log(peak.magnitude),
            ]
            functions = eleven_functions(self.model, alpha3)
            k, residues = functions.stiffness.real, functions.residues[:, 0].real
            static = (residues[:, POLES:] / k[POLES:]).sum(axis=1)
            terms = [
                np.log(k[:POLES]),
                functions.decay[:POLES],
                residues[:, :POLES].ravel(),
                static,
            ]
            self._values[alpha3] = Sample(np.array(live), np.concatenate(terms))
        return self._values[alpha3]

    def rate(self, alpha3: float) -> Sample:
        """Return d(values)/d(alpha3), from the model's equations."""
        if alpha3 not in self._rates:
            self._rates[alpha3] = _rates(self.model.solve(alpha3))
        return self._rates[alpha3]


def unpacked(terms: FloatArray, omega: FloatArray) -> ComplexArray:
    """Return the eleven FRFs of a table's terms at frequencies (rad/s), (n_lines, 11)."""
    k, c = np.exp(terms[:POLES]), terms[POLES : 2 * POLES]
    residues, static = terms[2 * POLES : -11].reshape(11, POLES), terms[-11:]
    w = omega[:, np.newaxis]
    return np.asarray((1.0 / (k - w**2 + 1j * w * c)) @ residues.T + static)


def _rates(solution: Solution) -> Sample:
    model = solution.model
    law = model.mechanism.damping
    assert isinstance(law, Rayleigh)  # as the linkage has it
    a, b = law.mass_coefficient, law.stiffness_coefficient
    omega = solution.modes.omega[:POLES]
    omega_rate = 2.0 * math.pi * undamped_slopes(solution)[:POLES]
    ratio_rate = (b - a / omega**2) * omega_rate / 2.0
    live = [*omega_rate[:MODES] / (2.0 * math.pi), *ratio_rate[:MODES], *_peak_rate(solution)]

    outputs, inputs = eleven(model, solution.configuration)
    out_rate, in_rate = _row_rates(model, solution)
    n = len(model.interface)
    shapes = solution.modes.shapes[:n, :POLES]
    shape_rates = np.column_stack([_shape_rate(solution, r)[:n] for r in range(POLES)])
    out, into = outputs @ shapes, inputs @ shapes
    residues = out * into
    residue_rates = (out_rate @ shapes + outputs @ shape_rates) * into
    residue_rates += out * (in_rate @ shapes + inputs @ shape_rates)
    k, k_rate = omega**2, 2.0 * omega * omega_rate
    static_rate = _receptance_rate(solution, 0.0)[1].real
    static_rate -= (residue_rates / k - residues * k_rate / k**2).sum(axis=1)
    terms = [k_rate / k, b * k_rate, residue_rates.ravel(), static_rate]
    return Sample(np.array(live), np.concatenate(terms))


def _shape_rate(solution: Solution, mode: int) -> FloatArray:
    """Return d(shape)/d(alpha3) of one mode, (n,), by Nelson's bordered system, without springs."""
    system, n_interface = solution.model.system, len(solution.model.interface)
    phi, squared = solution.modes.shapes[:, mode], solution.modes.omega[mode] ** 2
    rate = joining_rates(solution.model, solution.configuration.alpha3)[0]
    n, n_rows, b = len(phi), len(rate), slice(0, n_interface)
    compatibility = solution.joining.compatibility
    residual = (system.stiffness[b] - squared * system.mass[b]) @ phi
    multipliers = np.linalg.lstsq(compatibility.T, -residual, rcond=None)[0]
    # Interface forces of the constraints are scaled like stiffness, to compare rows.
    scale = float(np.abs(np.diag(system.stiffness)).max())
    matrix = np.zeros((n + n_rows + 1, n + n_rows + 1))
    matrix[:n, :n] = system.stiffness - squared * system.mass
    matrix[n : n + n_rows, b] = scale * compatibility
    matrix[:n, n : n + n_rows] = matrix[n : n + n_rows, :n].T
    matrix[:n, -1] = matrix[-1, :n] = -(system.mass @ phi) * math.sqrt(scale)
    right = np.zeros(len(matrix))
    right[b] = -rate.T @ multipliers
    right[n : n + n_rows] = -scale * (rate @ phi[b])
    return np.asarray(np.linalg.solve(matrix, right)[:n])


def _peak_rate(solution: Solution) -> tuple[float, float]:
    """Return d/d(alpha3) of the peak's frequency (Hz/rad) and of its logarithm (1/rad).

    At the peak g = d(abs(H)^2)/dw / 2 is zero at every angle, so dw/d(alpha3) = -g_alpha / g_w. The
    rate of the magnitude is that at a fixed frequency.
    """
    peak = solution.peak(solution.model.mechanism.response.peak_band)
    w = 2.0 * math.pi * peak.frequency
    step = _STEP * w
    drive = RESPONSES.index(FORCE)
    h, rate = np.array(
        [[x[drive] for x in _receptance_rate(solution, w + i * step)] for i in (-1, 0, 1)]
    ).T
    slope, bend = (h[2] - h[0]) / (2.0 * step), (h[2] - 2.0 * h[1] + h[0]) / step**2
    rate_slope = (rate[2] - rate[0]) / (2.0 * step)
    g_w = abs(slope) ** 2 + (h[1].conj() * bend).real
    g_alpha = (rate[1].conj() * slope + h[1].conj() * rate_slope).real
    growth = (h[1].conj() * rate[1]).real / abs(h[1]) ** 2
    return float(-g_alpha / g_w / (2.0 * math.pi)), float(growth)


def _receptance_rate(solution: Solution, omega: float) -> tuple[ComplexArray, ComplexArray]:
    """Return the eleven receptances at a frequency and d/d(alpha3) of them, (11,) each.

    In [[Z, B^T], [B, 0]] (u, mu) = (f, 0) only B and f change with the angle.
    """
    model, system = solution.model, solution.model.system
    n, n_interface = len(system.mass), len(model.interface)
    b = solution.joining.compatibility
    b_rate = joining_rates(model, solution.configuration.alpha3)[0]
    dynamic = system.stiffness + 1j * omega * system.damping - omega**2 * system.mass
    scale = float(np.abs(np.diag(system.stiffness)).max())
    matrix = np.zeros((n + len(b),) * 2, dtype=complex)
    matrix[:n, :n] = dynamic
    matrix[n:, :n_interface] = scale * b
    matrix[:n_interface, n:] = scale * b.T
    outputs, inputs = eleven(model, solution.configuration)
    out_rate, in_rate = _row_rates(model, solution)
    force = np.zeros(len(matrix))
    force[:n_interface] = inputs[0]
    x = np.linalg.solve(matrix, force)
    force_rate = np.zeros(len(matrix), dtype=complex)
    force_rate[:n_interface] = in_rate[0] - scale * b_rate.T @ x[n:]
    force_rate[n:] = -scale * b_rate @ x[:n_interface]
    x_rate = np.linalg.solve(matrix, force_rate)
    u, u_rate = x[:n_interface], x_rate[:n_interface]
    return np.asarray(outputs @ u), np.asarray(out_rate @ u + outputs @ u_rate)


def _row_rates(model: LinkageModel, solution: Solution) -> tuple[FloatArray, FloatArray]:
    """Return d/d(alpha3) of the rows of `eleven`."""
    alpha3 = solution.configuration.alpha3
    held = np.zeros((3, len(model.interface)))  # the centre of gravity has global axes of its own
    responses = row_rates(model, RESPONSES, alpha3)
    return np.vstack([responses, held]), row_rates(model, [FORCE], alpha3)
