# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the mechanism and the table that the parameters name, and builds a missing table."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from shlex import quote

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import TABLE_INFO
from linkage_vibration.prediction.answers import (
    Implement,
    Implements,
    LoadedModel,
    ModelWithoutTable,
    with_implement,
)
from linkage_vibration.prediction.doubts import linkage_doubts, tabulated_doubts
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.ground import vertical_mounts
from linkage_vibration.prediction.loads import ExcitationError, load_input
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.settings import ParameterError, Parameters
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.implements import read_implements
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.support.resources import command
from linkage_vibration.table.table import Table, load_table, refuse_other

Report = Callable[[str], object]
"""Takes a sentence, to show it."""
Keep = Callable[[Mechanism, Callable[[], Table]], Table]
"""Returns the table of a mechanism, kept from before or built by the function given."""


def load_model(
    settings: Parameters,
    report: Report | None = None,
    progress: Callable[[float], object] | None = None,
    keep: Keep | None = None,
) -> LoadedModel:
    """Return a mechanism with its table, which is built if the parameters name none for it.

    `report` is called with each doubt and before a table is built, and `progress` as `build_table`
    does; it may raise an error to stop. `keep` may know a table built before.
    """
    described = read_described(settings)
    mechanism = described.mechanism
    path, table_path = settings.mechanism_path(), settings.table_path()
    why = "table_file is not given"
    if table_path is not None:
        table = load_table(table_path)
        if described.implement is None or table.model_hash == mechanism.model_hash:
            refuse_other(table, table_path, mechanism, quote(str(path)))
            if report:
                for doubt in tabulated_doubts(mechanism, table):
                    report(f"{path}: {doubt}")
            return described.with_predictor(Predictor(table), table_path.read_bytes())
        why = "its implement is not that of the table"
    if report:
        for doubt in linkage_doubts(LinkageModel(mechanism)):
            report(f"{path}: {doubt}")

    def built() -> Table:
        if report:
            build = command(f"build {quote(str(path))}")
            saved = f"`{build}` saves a table, which then loads at once"
            saved = "it is kept for the next time" if keep else saved
            report(f"Building the table of {path}, as {why}; {saved}.")
        return built_table(LinkageModel(mechanism), progress)

    return described.with_predictor(Predictor(keep(mechanism, built) if keep else built()))


def load_variants(
    settings: Parameters, masses: Sequence[float], report: Report, keep: Keep
) -> list[LoadedModel]:
    """Return a mechanism and its table, perhaps by `keep`, with each mass of its implement, kg."""
    described, variants = read_described(settings), list[LoadedModel]()
    words = ", ".join(f"{mass:.5g}" for mass in masses)
    report(f"The implement has {words} kg, with the centre of gravity and the inertia of the file.")
    for mass in masses:
        mechanism, text = with_other_body(described, settings.mechanism_path(), mass=mass)
        model = LinkageModel(mechanism)
        for doubt in linkage_doubts(model):
            report(f"{mass:.5g} kg: {doubt}")
        predictor = Predictor(keep(mechanism, partial(built_table, model)))
        variants.append(ModelWithoutTable(mechanism, text).with_predictor(predictor))
    return variants


def built_table(model: LinkageModel, progress: Callable[[float], object] | None = None) -> Table:
    """Return the table of a model; few commands need what builds it."""
    from linkage_vibration.table.tabulation import build_table

    return build_table(model, progress=progress)


def read_described(settings: Parameters) -> ModelWithoutTable:
    """Return the mechanism that the parameters name, with the implement that they name."""
    path, file = settings.mechanism_path(), settings.implement_path()
    content, text = load_yaml(path)
    mechanism = mechanism_of(content, path)
    _check_room(path, mode_names=mechanism.response.modes)
    if file is None:
        if settings.implement:
            problem = f"Parameter implement is {settings.implement}, but implement_file is empty"
            raise ParameterError(f"{problem}; give the file of the implements.")
        return ModelWithoutTable(mechanism, text)
    implements = Implements(mechanism, text, read_implements(file, mechanism))
    if not settings.implement:
        return ModelWithoutTable(mechanism, text, None, implements)
    implement = implements.find(settings.implement)
    return ModelWithoutTable(*with_implement(mechanism, text, implement), implement, implements)


def with_other_body(
    described: ModelWithoutTable,
    path: Path,
    *,
    mass: float | None = None,
    inertia: float | None = None,
) -> tuple[Mechanism, str]:
    """Return a mechanism and its YAML with another mass or inertia of its only rigid body."""
    mechanism = described.mechanism
    if len(mechanism.rigid_bodies) != 1:
        hint = "another mass or inertia can be given only for a mechanism with exactly one"
        problem = f"{path} has {len(mechanism.rigid_bodies)} rigid bodies"
        raise ParameterError(f"{problem}; {hint} rigid body.")
    [body] = mechanism.rigid_bodies
    mass = body.mass if mass is None else mass
    implement = Implement(body.name, mass, body.inertia if inertia is None else inertia, ())
    return with_implement(mechanism, described.mechanism_text, implement)


def read_loads(
    settings: Parameters, served: LoadedModel, report: Report = lambda text: None
) -> tuple[Excitation, ...]:
    """Return the excitations; default ones that do not fit the mechanism have no amplitude."""
    path = settings.excitation_path()
    excitations = read_excitations(path)
    _check_room(path, excitations=len(excitations))
    if settings.excitation_file:
        return excitations
    fitted = fitting(excitations, served.table, served.mechanism)
    pairs = zip(excitations, fitted, strict=True)
    if refused := [each.name for each, fit in pairs if fit is not each]:
        report(
            f"{served.mechanism.name} or its table lacks the places at which {', '.join(refused)} "
            f"of {path} act, so their amplitudes are not used; give a file of your own with "
            "`--excitations`, or in the node's parameter excitation_file."
        )
    return fitted


def fitting(
    excitations: Sequence[Excitation], table: Table, mechanism: Mechanism
) -> tuple[Excitation, ...]:
    """Return excitations; those whose place a mechanism or its table lacks have no amplitude."""
    return tuple(
        each if _acts(each, table, mechanism) else replace(each, load=None, terrain=None)
        for each in excitations
    )


def _check_room(path: Path, **counts: int) -> None:
    """Refuse a file with longer lists, by the fields of ``TableInfo``, than messages can hold."""
    limits = {field.name: field.limit for field in message_fields(TABLE_INFO)}
    for name, count in counts.items():
        if count > limits[name]:
            what = "modes" if name == "mode_names" else name
            room = f"the messages of the node have room for {limits[name]}"
            raise ParameterError(f"{path} has {count} {what}, and {room}; reduce their number.")


def _acts(excitation: Excitation, table: Table, mechanism: Mechanism) -> bool:
    """Return whether a mechanism and its table have the places at which an excitation acts."""
    try:
        load_input(excitation.load, excitation.name, table, mechanism)
    except ExcitationError:
        return False
    return excitation.terrain is None or len(vertical_mounts(mechanism)) > 1
