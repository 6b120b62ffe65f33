# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The message on ``~/table_info``."""

from builtin_interfaces.msg import Time

from linkage_vibration.prediction.answers import place_name
from linkage_vibration.table.table import Table
from linkage_vibration_interfaces.msg import TableInfo


def table_info(table: Table, stamp: Time) -> TableInfo:
    """Return the message that describes a table.

    Parameters
    ----------
    table : Table
        The table.
    stamp : Time
        Since when the node uses it.
    """
    first, last = table.alpha3_range
    sound_first, sound_last = table.sound_range
    return TableInfo(
        stamp=stamp,
        table_id=table.table_id,
        mechanism_name=table.mechanism_name,
        model_hash=table.model_hash,
        package_version=table.package_version,
        crank_angle_first=first,
        crank_angle_last=last,
        sound_first=max(first, sound_first),
        sound_last=min(last, sound_last),
        band_low=table.band[0],
        band_high=table.band[1],
        n_modes=table.n_modes,
        n_points=len(table.alpha3),
        interpolation_error=float(table.interpolation_error.max()),
        peak_error=table.peak_error,
        frf_error=table.frf_error,
        places=[place_name(place) for place in table.places],
    )
