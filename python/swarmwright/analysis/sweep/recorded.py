"""Sweeps that are repeated or completed by the record that they wrote beside their runs, `sweep.json`."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from swarmwright.analysis.sweep.effect import leaves, value_at
from swarmwright.analysis.sweep.run import comparable
from swarmwright.analysis.sweep.variants import Variant
from swarmwright.analysis.sweep_folders import names_of, no_record
from swarmwright.core.errors import InputError
from swarmwright.core.yaml import dotted_path
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.settings import parse_settings
from swarmwright.runs.code import used_for
from swarmwright.runs.edits import differences
from swarmwright.runs.run import Run
from swarmwright.store import FILE as STORE
from swarmwright.user_code.copying import display_name

_Copies = dict[tuple[str, str], str]
"""Names of simulations, by what they are called and the SHA-256 of their code."""


def is_record(values: Any) -> bool:  # noqa: ANN401 - whatever a file says
    """Return whether a file is the record of a sweep, rather than a sweep file."""
    return isinstance(values, Mapping) and "variants" in values


def sweep_of(
    file: Path, values: Mapping[str, Any], out: Path | None, settings: Iterable[str]
) -> dict[str, Any]:
    """Return the fields of a `Sweep`, as the record of one has them.

    A variant is what its runs beside the record hold, with the code that they were computed with; the record
    alone where there are none.

    Args:
        file: the record.
        values: that it holds.
        out: folder for the runs; default: the record's, where those that are missing are run.
        settings: as in `Experiment.load`, for all variants.

    Raises:
        InputError: the file is not such a record, a variant cannot be used here, its code is not trusted, a
            run is not of its variant, or a setting would make variants the same.
    """
    settings = tuple(settings)
    try:
        seeds = tuple(map(int, values["seeds"]))
        earlier = tuple(map(str, values["settings"]))
        name = None if values["file"] is None else Path(values["file"])
        found = [
            (
                str(one["label"]),
                _folder(names_of(one["runs"]), seeds),
                {**values["experiment"], **one["experiment"]},
                tuple(map(str, one.get("keys", ()))),  # earlier versions did not write them
            )
            for one in values["variants"]
        ]
        if not found:
            raise ValueError("variants: none")
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise no_record(file) from error
    copies: _Copies = {}
    variants = []
    for label, folder, kept, keys in found:
        folders = [file.parent / f"{folder}-{seed}" for seed in seeds]
        try:
            variants.append(Variant(label, folder, _experiment(folders, kept, copies), keys=keys))
        except InputError as error:
            raise InputError(f"{file}: {label}: {error}") from error
    return {
        "variants": _changed(variants, settings),
        "seeds": seeds,
        "out": out or file.parent,
        "file": name,
        "settings": (*earlier, *settings),
    }


def _folder(names: Sequence[str], seeds: Sequence[int]) -> str:
    """Return the name of a variant's folders without the seed. Raises ValueError where there is none."""
    folder = names[0].removesuffix(f"-{seeds[0]}")
    if not folder or list(names) != [f"{folder}-{seed}" for seed in seeds]:
        raise ValueError("runs: not a folder for each seed")
    return folder


def _experiment(folders: Iterable[Path], values: Mapping[str, Any], copies: _Copies) -> Experiment:
    """Return the experiment of a variant.

    Args:
        folders: of its runs.
        values: of the record.
        copies: of code that other variants use; equal ones are one simulation, with the same servers.
    """
    run = _first(folders)
    if run is None:
        experiment = Experiment.from_mapping(values)
        experiment.check_new()
        return experiment
    recorded = Experiment.unasked(values)
    differing = [
        one for one in differences(comparable(run.experiment), comparable(recorded)) if one.key != "seed"
    ]
    if differing:
        raise InputError(
            f"{run.path}: holds a run of another experiment: {', '.join(map(str, differing))}; move it "
            "elsewhere"
        )
    experiment = used_for(run)
    simulation = experiment.simulation
    if run.code:
        key = display_name(simulation), run.code[max(run.code)]
        simulation = copies.setdefault(key, simulation)
    experiment = dataclasses.replace(
        experiment, simulation=simulation, validate=recorded.validate, seed=recorded.seed
    )
    experiment.check_new()
    return experiment


def _first(folders: Iterable[Path]) -> Run | None:
    """Return the first run that is there and can be read."""
    for folder in folders:
        with suppress(InputError):  # a damaged one is named when it is its turn
            if (folder / STORE).exists():
                return Run.open(folder)
    return None


def _changed(variants: Sequence[Variant], settings: Sequence[str]) -> tuple[Variant, ...]:
    """Return variants with settings. Raises InputError where these concern what differs between them."""
    experiments = [one.experiment for one in variants]
    for setting in parse_settings(settings):
        for leaf in leaves(setting.path, setting.value):
            if len({value_at(one, leaf) for one in experiments}) > 1:
                raise InputError(
                    f"{setting.text}: the variants of this sweep differ in {dotted_path(leaf)}; leave it "
                    "out, or change a copy of the sweep file"
                )
    changed = tuple(
        dataclasses.replace(one, experiment=one.experiment.with_settings(settings)) for one in variants
    )
    if len({one.experiment for one in changed}) < len(changed):
        raise InputError(
            f"{', '.join(settings)}: several variants of this sweep would be the same experiment; leave it "
            "out, or change a copy of the sweep file"
        )
    return changed
