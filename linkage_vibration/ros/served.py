# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node publishes and logs about its mechanism and its table."""

from builtin_interfaces.msg import Time

from linkage_vibration.bags.recorder import Provenance, package_versions
from linkage_vibration.messages.provenance import attachments
from linkage_vibration.prediction.answers import Served, place_name
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.table.table import Table
from linkage_vibration_interfaces.msg import TableInfo


def provenance(
    served: Served, settings: Parameters, excitations: str, node_name: str
) -> Provenance:
    """Return what a log keeps of the model and the parameters that made its messages.

    Parameters
    ----------
    served : Served
        The mechanism and its table.
    settings : Parameters
        The node's parameters.
    excitations : str
        YAML of the excitations.
    node_name : str
        Name of the node with its namespace.
    """
    facts = {"table_id": served.table.table_id, "mechanism": served.mechanism.name}
    files = attachments(served, settings, node_name, excitations)
    return Provenance(files, {**package_versions(), **facts})


def table_info(table: Table, stamp: Time) -> TableInfo:
    """Return what ``~/table_info`` tells of a table in use since a time."""
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
