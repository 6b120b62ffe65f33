# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The files that a log attaches, so that its predictions can be reproduced."""

from collections.abc import Mapping
from dataclasses import replace

from linkage_vibration.bags.writing import Attachment
from linkage_vibration.prediction.answers import LoadedModel
from linkage_vibration.prediction.parameter_files import parameters_yaml
from linkage_vibration.prediction.settings import Parameters

MECHANISM, PARAMETERS = "mechanism.yaml", "parameters.yaml"
EXCITATIONS = "excitations.yaml"


def implement_facts(served: LoadedModel) -> dict[str, str]:
    """Return the name of the implement in use as metadata of a log; empty if it has none."""
    name = "" if served.implement is None else served.implement.name
    return {"implement": name} if name else {}


def attachments(
    served: LoadedModel, settings: Parameters, node_name: str, excitations: Mapping[str, bytes]
) -> tuple[Attachment, ...]:
    """Return what made the messages of a log as files; those of excitations are given by name."""
    if settings.implement_file:  # the one in use, which is not always that of the start
        settings = replace(settings, implement=implement_facts(served).get("implement", ""))
    texts = {MECHANISM: served.mechanism_text, PARAMETERS: parameters_yaml(settings, node_name)}
    files = [Attachment(name, "application/yaml", text.encode()) for name, text in texts.items()]
    for name, data in excitations.items():
        kind = "application/yaml" if name.endswith(".yaml") else "text/csv"
        files.append(Attachment(name, kind, data))
    table = f"{served.table.table_id}.npz"
    files.insert(1, Attachment(table, "application/x-npz", served.table_file))
    return tuple(files)
