# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Places the pins of a linkage, and finds its crank angle and a wrong pin in a photograph."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import t as student

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import GROUND, Mechanism, Point
from linkage_vibration.mechanics.kinematics import Configuration, Kinematics

_ANGLES = 91  # over the stroke, to begin the search from
_NEAR_TOGGLE = 1e-6  # rad
_STEP = 1e-5  # rad, of a difference
_OUTLIER = 3.0  # by which the scatter falls without a wrong pin
_MOVES = 1e-9  # m/rad; less is rounding
_LARGEST = 1e6  # pixels; no photograph is as large
_FEWEST = 4  # pins, for a standard deviation


class PoseError(LinkageVibrationError):
    """A pose cannot be computed as requested."""


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """The crank angle at which the pins of a linkage lie as in a photograph.

    Attributes
    ----------
    alpha3, stddev : float
        rad; the standard deviation follows from the scatter, and is NaN with fewer than four pins.
    scale : float
        m per pixel.
    mirrored : bool
        Whether the photograph shows the linkage with x to the left.
    pins : tuple of str
    places, off : ndarray, (n_pins, 2) and (n_pins,)
        Where the photograph shows the pins, in the axes of the ground, m, and their distances from
        the pins of the linkage, m.
    scatter : float
        Root of the sum of squares of these over the degrees of freedom, in each direction, m.
    """

    alpha3: float
    stddev: float
    scale: float
    mirrored: bool
    pins: tuple[str, ...]
    places: FloatArray
    off: FloatArray
    scatter: float


def pin_places(mechanism: Mechanism, configuration: Configuration) -> dict[str, FloatArray]:
    """Return the place of every point of the ground and of the bodies, (2,), m.

    Parameters
    ----------
    mechanism, configuration : Mechanism and Configuration
    """
    names = (GROUND, *(body.name for body in mechanism.bodies))
    return {
        point: configuration.place(name, local)
        for name in names
        for point, local in mechanism.local_points(name).items()
    }


def read_pins(words: Sequence[str], mechanism: Mechanism) -> dict[str, Point]:
    """Return the pixels of pins in words such as ``P1=412,633``.

    Parameters
    ----------
    words, mechanism : sequence of str and Mechanism

    Raises
    ------
    PoseError
        If a word has another form, or the linkage has no such point.
    """
    known = {
        p for b in (GROUND, *(b.name for b in mechanism.bodies)) for p in mechanism.local_points(b)
    }
    found: dict[str, Point] = {}
    for word in words:
        name, _, numbers = word.partition("=")
        try:
            x, y = map(float, numbers.split(","))
        except ValueError:
            x = y = math.nan
        if not abs(x) + abs(y) < _LARGEST:
            raise PoseError(f"{word}: write PIN=X,Y in pixels, such as P1=412,633.")
        if name not in known:
            raise PoseError(
                f"{word}: there is no pin {name}; name one of {', '.join(sorted(known))}."
            )
        if name in found:
            raise PoseError(f"{word}: the pin {name} is given twice; give each pin once.")
        found[name] = (x, y)
    return found


def fit_photo(mechanism: Mechanism, kinematics: Kinematics, pixels: Mapping[str, Point]) -> Photo:
    """Find the crank angle at which pins lie as in a photograph, seen along the pins.

    The pixels are shifted, turned and scaled so that they meet the pins best (least squares); y
    points down in a photograph. Both directions of x are tried.

    Parameters
    ----------
    mechanism, kinematics : Mechanism and Kinematics
    pixels : mapping of str to (x, y)
        At least three pins.

    Raises
    ------
    PoseError
        If there are fewer than three pins, if they lie in one place, or if none of them moves.
    """
    names = tuple(pixels)
    if len(names) < 3:
        raise PoseError(
            f"{len(names)} pins do not show the angle; give three or more, and five or more to "
            "find a wrong one."
        )
    seen = np.array(list(pixels.values())) * [1.0, -1.0]
    if np.ptp(seen, axis=0).max() < 1.0:
        raise PoseError("All pins lie within one pixel; give their places in the photograph.")
    low, high = kinematics.closable_range
    low, high = (
        max(low + _NEAR_TOGGLE, mechanism.stroke[0]),
        min(high - _NEAR_TOGGLE, mechanism.stroke[1]),
    )

    def places(alpha3: float) -> FloatArray:
        found = pin_places(mechanism, kinematics.at(alpha3))
        return np.array([found[name] for name in names])

    fits = []
    for mirrored in (False, True):
        own = seen * [-1.0, 1.0] if mirrored else seen

        def squares(alpha3: float, own: FloatArray = own) -> float:
            return float((_fitted(own, places(alpha3))[1] ** 2).sum())

        grid = np.linspace(low, high, _ANGLES)
        best = int(np.argmin([squares(alpha3) for alpha3 in grid.tolist()]))
        ends = grid[max(best - 1, 0)], grid[min(best + 1, _ANGLES - 1)]
        found = minimize_scalar(squares, bounds=ends, method="bounded", options={"xatol": 1e-8})
        fits.append((float(found.fun), float(found.x), mirrored, own))
    _, alpha3, mirrored, own = min(fits, key=lambda fit: fit[0])
    shown, rest, scale = _fitted(own, places(alpha3))
    freedom = 2 * len(names) - 5
    scatter = math.sqrt(float((rest**2).sum()) / freedom)
    ahead = _fitted(own, places(min(alpha3 + _STEP, high)))[1]
    back = _fitted(own, places(max(alpha3 - _STEP, low)))[1]
    slope = math.sqrt(float((((ahead - back) / (2.0 * _STEP)) ** 2).sum()))
    if slope < _MOVES:
        raise PoseError(
            f"The pins {', '.join(names)} do not move against one another, so they do not show the "
            f"angle; add pins of {mechanism.input_body} or of bodies that it moves."
        )
    # Few pins show their scatter badly; so widened, 1.96 standard deviations contain 95 %.
    wide = float(student.ppf(0.975, freedom)) / 1.96
    stddev = wide * scatter / slope if len(names) >= _FEWEST else math.nan
    off = np.hypot(*rest.T)
    return Photo(alpha3, stddev, scale, mirrored, names, shown, off, scatter)


def wrong_pin(
    mechanism: Mechanism, kinematics: Kinematics, pixels: Mapping[str, Point], photo: Photo
) -> tuple[str, Photo] | None:
    """Return the pin without which the others agree far better, and their fit; None if none.

    Parameters
    ----------
    mechanism, kinematics, pixels
        As `fit_photo` takes them.
    photo : Photo
        The fit of all pins.
    """
    if len(pixels) < 5:
        return None
    rest = [{name: at for name, at in pixels.items() if name != left} for left in pixels]
    fits = [fit_photo(mechanism, kinematics, others) for others in rest]
    best = min(range(len(fits)), key=lambda i: fits[i].scatter)
    if fits[best].scatter * _OUTLIER > photo.scatter:
        return None
    return list(pixels)[best], fits[best]


def angle_rows(mechanism: Mechanism, kinematics: Kinematics, angles: Sequence[float]) -> str:
    """Return a table of the angles of the bodies, and of the place of the drive point.

    Parameters
    ----------
    mechanism, kinematics : Mechanism and Kinematics
    angles : sequence of float
        Crank angles, rad.
    """
    names = [body.name for body in mechanism.bodies if body.name != mechanism.input_body]
    point = mechanism.response.point
    heads = [
        "alpha3 [deg]",
        *(f"{name} [deg]" for name in names),
        f"{point} x [m]",
        f"{point} z [m]",
    ]
    widths = [max(len(head) + 2, 12) for head in heads]
    lines = ["".join(f"{head:>{width}}" for head, width in zip(heads, widths, strict=True))]
    for alpha3 in angles:
        configuration = kinematics.at(alpha3)
        degrees = [math.degrees(configuration.angle(name)) % 360.0 for name in names]
        x, z = pin_places(mechanism, configuration)[point]
        cells = [
            f"{math.degrees(alpha3):.2f}",
            *(f"{d:.2f}" for d in degrees),
            f"{x:.3f}",
            f"{z:.3f}",
        ]
        lines.append("".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True)))
    return "\n".join(lines)


def described(photo: Photo, wrong: tuple[str, Photo] | None) -> str:
    """Return what a photograph shows, in words.

    Parameters
    ----------
    photo, wrong
        As `fit_photo` and `wrong_pin` return them.
    """
    known = "unknown" if math.isnan(photo.stddev) else f"{math.degrees(photo.stddev):.2f}"
    side = "left" if photo.mirrored else "right"
    lines = [
        f"The photograph shows alpha3 = {math.degrees(photo.alpha3):.2f} deg (standard deviation "
        f"{known} deg), with x to the {side} and {1000.0 * photo.scale:.3g} mm per pixel.",
        f"{'pin':>8}{'off [mm]':>12}",
    ]
    pairs = zip(photo.pins, photo.off.tolist(), strict=True)
    lines += [f"{name:>8}{1000.0 * off:12.1f}" for name, off in pairs]
    if wrong is not None:
        name, rest = wrong
        lines.append(
            f"Without {name}, the others agree within {1000.0 * rest.off.max():.1f} mm, at alpha3 "
            f"= {math.degrees(rest.alpha3):.2f} deg: measure {name} again, on the hitch and in the "
            "photograph."
        )
    return "\n".join(lines)


def _fitted(seen: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return pixels as places, shifted, turned and scaled to meet others; what is left; the scale.

    Pixels and places are (n, 2); x + i z turns and scales them by one complex factor.
    """
    own, other = seen @ [1.0, 1j], places @ [1.0, 1j]
    centred = own - own.mean()
    factor = (centred.conj() @ (other - other.mean())) / (centred.conj() @ centred).real
    shown = factor * centred + other.mean()
    shown = np.stack([shown.real, shown.imag], axis=1)
    return shown, shown - places, float(abs(factor))
