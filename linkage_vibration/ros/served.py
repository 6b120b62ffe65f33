# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism, its table and its excitations, as the node's parameters name them."""

from collections.abc import Callable

from builtin_interfaces.msg import Time

from linkage_vibration.bags.recorder import Provenance, package_versions
from linkage_vibration.bags.writing import Attachment
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.answers import Served, place_name
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.settings import Parameters, parameters_yaml
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.table.table import Table, load_table, table_bytes
from linkage_vibration.table.tabulation import build_table
from linkage_vibration_interfaces.msg import TableInfo


def load_served(
    settings: Parameters, say: Callable[[str], object], check: Callable[[], None]
) -> Served:
    """Return the mechanism with its table, read or built.

    Parameters
    ----------
    settings : Parameters
        Name the files.
    say : callable
        Called with a sentence before a table is built, as that takes seconds.
    check : callable
        Called again and again while it is; raises when going on has become pointless.

    Raises
    ------
    LinkageVibrationError
        If a file cannot be used, or the mechanism cannot be tabulated.
    """
    path, table_path = settings.mechanism_path(), settings.table_path()
    mechanism = read_mechanism(path)
    if table_path is not None:
        table = load_table(table_path, mechanism)
    else:
        say(
            f"Building the table of {path}, as table_file is not given; "
            "`linkage-vibration build` makes one once and for all."
        )
        table = build_table(LinkageModel(mechanism), solved=check)
    return Served(Predictor(table), mechanism, path.read_text(encoding="utf-8"))


def provenance(
    served: Served, settings: Parameters, excitations: str, node_name: str
) -> Provenance:
    """Return what a log keeps of the model and the parameters that made its messages.

    Parameters
    ----------
    excitations : str
        Their YAML.
    node_name : str
        With its namespace.
    """
    name, table = served.mechanism.name, served.table
    parameters = parameters_yaml(settings, node_name)
    return Provenance(
        (
            Attachment(f"{name}.yaml", "application/yaml", served.mechanism_text.encode()),
            Attachment(f"{table.table_id}.npz", "application/x-npz", table_bytes(table)),
            Attachment("excitations.yaml", "application/yaml", excitations.encode()),
            Attachment("parameters.yaml", "application/yaml", parameters.encode()),
        ),
        {**package_versions(), "table_id": table.table_id, "mechanism": name},
    )


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
