# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A base that moves: the tractor, to which the points of the ground belong.

The base is a rigid body on mounts, such as tyres. It does not move in the kinematics, so the
configuration is that of a linkage on a fixed ground; it only vibrates, with three degrees of
freedom.
"""

import re

from linkage_vibration.mechanics.description import GROUND, Mount
from linkage_vibration.mechanics.keys import DAMPEST, RIGID, STIFFEST, CheckedMapping

# The width is in mm if the ratio of height to width follows, else in inches: 420/85R34, 16.9R38.
_SIZE = re.compile(r"(?:IF|VF)? ?(\d+(?:\.\d+)?)(/\d+)? ?[R-] ?(\d+(?:\.\d+)?)")


def read_mounts(keys: CheckedMapping, taken: set[str]) -> tuple[Mount, ...]:
    """Read the mounts of a base, none of which may have the name of a point that is `taken`."""
    mounts = []
    for name in keys.names("mounts"):
        if name in taken or name == GROUND:
            problem = "a point has this name already; give the mount another one."
            raise keys["mounts"].error(name, problem)
        mount = keys["mounts"][name]
        if "tyre" in mount:
            if not mount.is_mapping("tyre"):
                hint = "write {size: 420/85R34, pressure: 1.2e+5}, with the pressure in Pa."
                raise mount.error("tyre", f"it has no pressure; {hint}")
            stiffness = mount.number("stiffness_x"), tyre_stiffness(mount["tyre"])
        else:
            stiffness = mount.pair("stiffness")
        damping = mount.pair("damping") if "damping" in mount else (0.0, 0.0)
        for along in (0, 1):
            key = "stiffness_x" if "tyre" in mount else "stiffness"
            mount.refuse_outside(key, stiffness[along], 0.0, STIFFEST, RIGID)
            mount.refuse_outside("damping", damping[along], 0.0, DAMPEST, RIGID)
        hint = "give the distance of both wheels in m, or 0 for one wheel"
        track = mount.number("track", default=0.0, least=0.0, most=10.0, hint=hint)
        mounts.append(Mount(name, mount.point("at"), stiffness, damping, track))
    return tuple(mounts)


def tyre_stiffness(keys: CheckedMapping) -> float:
    """Return the vertical stiffness of rolling tyres, N/m, by their size, age and pressure.

    One has 172 - 1.77 D + 5.6 A + 0.34 W D p kN/m: rim D and width W in inches, age A in years, p
    in bar (Lines and Murphy, J. Terramechanics 28, 1991; quoted from memory); `factor` corrects it.
    """
    inches = "give inches, as on the tyre: 16.9R38 has a width of 16.9 and a rim of 38"
    width, rim = _tyre_size(keys)
    of_width, of_rim = ("size", "size") if "size" in keys else ("width_in", "rim_in")
    keys.refuse_outside(of_width, width, 4.0, 50.0, f"{inches}, or `size: 420/85R34`")
    keys.refuse_outside(of_rim, rim, 8.0, 60.0, inches)
    age = keys.number("age_years", default=0.0, least=0.0, most=30.0, hint="give years")
    pressure = keys.number("pressure", least=2e4, most=5e5, hint="give Pa; 1 bar is 1.0e+5")
    factor = keys.number("factor", default=1.0, least=0.2, most=5.0, hint="1 is the formula")
    stiffness = 172.0 - 1.77 * rim + 5.6 * age + 0.34 * width * rim * pressure / 1e5
    return keys.integer("count", default=1) * factor * 1e3 * stiffness


def _tyre_size(keys: CheckedMapping) -> tuple[float, float]:
    """Return the width and the rim of a tyre, inches, which may be as written on it."""
    if "size" not in keys:
        return keys.number("width_in"), keys.number("rim_in")
    found = _SIZE.fullmatch(keys.text("size"))
    if found is None:
        raise keys.error("size", "it cannot be read; write for example 420/85R34 or 16.9R38.")
    width, ratio, rim = found.groups()
    return float(width) / (25.4 if ratio else 1.0), float(rim)
