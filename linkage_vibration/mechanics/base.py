# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A base that moves: the tractor, to which the points of the ground belong.

The base is a rigid body on mounts, such as tyres. It does not move in the kinematics, so the
configuration is that of a linkage on a fixed ground; it only vibrates, with three degrees of
freedom in the plane. In a spatial model it is held out of the plane, as rigid bodies are.
"""

from linkage_vibration.mechanics.description import GROUND, Base, Mount
from linkage_vibration.mechanics.keys import DAMPEST, STIFFEST, Keys


def mount_springs(base: Base | None) -> tuple[tuple[Mount, int], ...]:
    """Return each mount with 0 for its spring along x or 1 for that along z, if it has one."""
    return tuple(
        (mount, axis)
        for mount in (base.mounts if base else ())
        for axis in (0, 1)
        if mount.stiffness[axis] or mount.damping[axis]
    )


def read_mounts(keys: Keys, taken: set[str]) -> tuple[Mount, ...]:
    """Read the mounts of a base, none of which may have the name of a point that is `taken`."""
    mounts = []
    for name in keys.names("mounts"):
        if name in taken or name == GROUND:
            raise keys["mounts"].error(
                name, "a point has this name already; give the mount another one."
            )
        mount = keys["mounts"][name]
        damping = mount.pair("damping") if "damping" in mount else (0.0, 0.0)
        pairs = {"stiffness": mount.pair("stiffness"), "damping": damping}
        for key, values in pairs.items():
            if min(values) < 0.0:
                raise mount.error(key, f"{min(values):g} is below zero; give [along x, along z].")
            mount.refuse_rigid(key, max(values), STIFFEST if key == "stiffness" else DAMPEST)
        mounts.append(Mount(name, mount.point("at"), pairs["stiffness"], pairs["damping"]))
    return tuple(mounts)
