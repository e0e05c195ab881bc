"""Repeat or complete a sweep from the record in its folder, `sweep.json`."""

import dataclasses
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmwright.analysis.sweep.variants import Variant, are_seeds, comparable, leaves, value_at
from swarmwright.analysis.sweep_folders import names_of
from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import is_in_file, is_python
from swarmwright.common.yaml import format_path
from swarmwright.experiment.budget import LIMITS
from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD, Experiment, build_recorded_experiment
from swarmwright.experiment.settings import parse_settings
from swarmwright.runs.code import find_copy, resolve_experiment
from swarmwright.runs.edits import differences
from swarmwright.runs.run import Run
from swarmwright.runs.store import FILE as STORE
from swarmwright.simulations.user_code.copying import compute_digest, display_name
from swarmwright.simulations.user_code.permission import require_file, require_named

_CLASSES = ("method", "ranking")
"""Sections whose kind may be a class in a file."""
_MODULES = ("behaviours", "conditions")
"""Options of a controller that name modules, which may be in files."""


@dataclass
class _Code:
    """The code of the runs beside a record."""

    used: dict[str, str] = field(default_factory=dict)
    """Code of simulations, behaviours and conditions, by their names in the record."""
    runs: dict[str, tuple[str, Run]] = field(default_factory=dict)
    """SHA-256 of each simulation's code with a run computed by it, by its name in the record."""
    copies: dict[tuple[str, str], str] = field(default_factory=dict)
    """Simulations by displayed name and SHA-256, so that equal copies count as the same simulation."""


def is_record(values: Any) -> bool:  # noqa: ANN401 - whatever a file says
    """Return whether a file is the record of a sweep, rather than a sweep file."""
    return (
        isinstance(values, Mapping)
        and "variants" in values
        and ("settings" in values or isinstance(values["variants"], list))
        and not values.keys() & {"grid", "out"}
    )


def load_recorded_sweep(
    file: Path, values: Mapping[str, Any], out: Path | None, settings: Iterable[str]
) -> dict[str, Any]:
    """Load the fields of a `Sweep` from its record.

    A variant with runs beside the record has their experiment and code. A variant without a run is as
    recorded, with the code of other variants' runs, or else with the code that the record names, if it is
    trusted.

    Args:
        file: the record.
        values: its content.
        out: folder for the runs; by default the record's, to add missing runs there.
        settings: as in `Experiment.load`, for all variants.

    Raises:
        InputError: the file is not a record, a variant cannot be used on this machine, its code is not
            trusted, a run is not of its variant, runs were computed with different code, or a setting would
            make variants equal.
    """
    settings = tuple(settings)
    try:
        seeds = _seeds(values["seeds"])
        earlier = _texts(values["settings"], "settings")
        name = None if values["file"] is None else Path(values["file"])
        entries = [
            (
                str(variant["label"]),
                _folder(names_of(variant["runs"]), seeds),
                {**values["experiment"], **variant["experiment"]},
                _texts(variant["keys"], "keys"),
            )
            for variant in values["variants"]
        ]
        if not entries:
            raise ValueError("variants: none")
    except (ValueError, KeyError, TypeError, IndexError) as error:
        problem = f"without the key {error}" if isinstance(error, KeyError) else error
        raise InputError(
            f"{file}: is not a valid record of a sweep ({problem}); start the sweep with its sweep file"
        ) from error
    runs = [
        _open_first_readable(file.parent / f"{folder}-{seed}" for seed in seeds) for _, folder, *_ in entries
    ]
    code = _Code()
    variants: dict[int, Variant] = {}
    for index in sorted(range(len(entries)), key=lambda index: runs[index] is None):
        label, folder, values_of_variant, keys = entries[index]
        run = runs[index]
        try:
            recorded = build_recorded_experiment(values_of_variant)
            experiment = (
                _restore_without_run(values_of_variant, recorded, code)
                if run is None
                else _restore_from_run(run, recorded, code)
            )
        except InputError as error:
            raise InputError(f"{file}: {label}: {error}") from error
        names = dict(zip(_list_names(experiment), _list_names(recorded), strict=True))
        variants[index] = Variant(label, folder, experiment, keys=keys, names=names)
    return {
        "variants": _apply_settings(file, [variants[index] for index in range(len(entries))], settings),
        "seeds": seeds,
        "out": out or file.parent,
        "file": name,
        "settings": (*earlier, *settings),
    }


def with_names(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Return the keys of an experiment with its simulation and plug-ins in files renamed."""
    changed = {**values, "simulation": _rename(values["simulation"], names)}
    for key in _CLASSES:
        section = values.get(key)
        if isinstance(section, Mapping) and "kind" in section:
            changed[key] = {**section, "kind": _rename(section["kind"], names)}
    controller = values.get("controller")
    if isinstance(controller, Mapping):
        lists = {key: controller[key] for key in _MODULES if isinstance(controller.get(key), list)}
        changed["controller"] = {
            **controller,
            **{key: [_rename(module, names) for module in modules] for key, modules in lists.items()},
        }
    return changed


def _rename(name: Any, names: Mapping[str, str]) -> Any:  # noqa: ANN401 - whatever a file says
    return names.get(name, name) if isinstance(name, str) else name


def _list_names(experiment: Experiment) -> list[str]:
    """Return the names of an experiment's simulation and of components that may be plug-ins in files."""
    lists = (getattr(experiment.controller, key, None) for key in _MODULES)
    modules = (name for listed in lists if isinstance(listed, list | tuple) for name in listed)
    return [experiment.simulation, *(getattr(experiment, key).kind for key in _CLASSES), *modules]


def _seeds(seeds: Any) -> tuple[int, ...]:  # noqa: ANN401 - whatever a file says
    if not are_seeds(seeds) or len(set(seeds)) < len(seeds):
        raise ValueError("seeds: not a list of different integers from 0")
    return tuple(seeds)


def _texts(texts: Any, key: str) -> tuple[str, ...]:  # noqa: ANN401 - whatever a file says
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise ValueError(f"{key}: not a list of strings")
    return tuple(texts)


def _folder(names: Sequence[str], seeds: Sequence[int]) -> str:
    """Return the name of a variant's folders without the seed. Raises ValueError if there is none."""
    folder = names[0].removesuffix(f"-{seeds[0]}")
    if not folder or list(names) != [f"{folder}-{seed}" for seed in seeds]:
        raise ValueError("runs: not a folder for each seed")
    return folder


def _restore_without_run(values: Mapping[str, Any], recorded: Experiment, code: _Code) -> Experiment:
    """Return the experiment of a variant without a run.

    Args:
        values: from the record.
        recorded: the same as an experiment, without its code.
        code: of other variants' runs.

    Raises InputError when code that the record names is not trusted, or the experiment cannot be used.
    """
    simulation, *modules = _list_names(recorded)
    if simulation not in code.used and is_python(simulation):
        require_named(simulation)
    for name in modules:
        if name not in code.used and is_in_file(name):
            require_file(name)
    return Experiment.from_mapping(with_names(values, code.used))


def _restore_from_run(run: Run, recorded: Experiment, code: _Code) -> Experiment:
    """Return the experiment of a variant from its run, and add the run's code to `code`.

    Raises InputError when the run is of another experiment, its code is not trusted, or differs from that of
    other runs of the simulation.
    """
    differing = [
        difference
        for difference in differences(comparable(run.experiment), comparable(recorded))
        if difference.key != "seed"
    ]
    if differing:
        raise InputError(
            f"{run.path}: holds a run of another experiment: {', '.join(map(str, differing))}; move it to "
            "another folder"
        )
    experiment = resolve_experiment(run)
    simulation = experiment.simulation
    copy = find_copy(run)
    if copy is not None and "simulation" in copy.parts:
        digest = compute_digest({"simulation": copy.parts["simulation"].digests})
        first_digest, first_run = code.runs.setdefault(recorded.simulation, (digest, run))
        if first_digest != digest:
            raise InputError(
                f"{run.path}: the code of {display_name(simulation)} differs from that of {first_run.path}. "
                "Runs of different code cannot be compared; move the runs of one of them to another folder"
            )
        simulation = code.copies.setdefault((display_name(simulation), digest), simulation)
    limits: dict[str, Any] = {limit: getattr(recorded.method, limit) for limit in LIMITS}
    experiment = dataclasses.replace(
        experiment,
        simulation=simulation,
        method=experiment.method.model_copy(update=limits),
        validate=recorded.validate,
        seed=recorded.seed,
    )
    for name, used in zip(_list_names(recorded), _list_names(experiment), strict=True):
        code.used.setdefault(name, used)
    return experiment


def _open_first_readable(folders: Iterable[Path]) -> Run | None:
    """Return the first readable run."""
    for folder in folders:
        with suppress(InputError):  # a damaged run is reported later
            if (folder / STORE).exists():
                return Run.open(folder)
    return None


def _apply_settings(file: Path, variants: Sequence[Variant], settings: Sequence[str]) -> tuple[Variant, ...]:
    """Return variants with settings. Raises InputError for settings of keys in which variants differ."""
    experiments = [variant.experiment for variant in variants]
    for setting in parse_settings(settings):
        for leaf in leaves(setting.path, setting.value):
            if len({value_at(experiment, leaf) for experiment in experiments}) > 1:
                raise InputError(
                    f"{setting.text}: the variants of this sweep differ in {format_path(leaf)}; omit the "
                    "setting, or change a copy of the sweep file"
                )
    distinct: dict[str, Variant] = {}
    for variant in variants:
        changed = dataclasses.replace(variant, experiment=variant.experiment.with_settings(settings))
        same = distinct.setdefault(_make_key(changed.experiment), changed)
        if same is changed:
            continue
        if settings:
            raise InputError(
                f"{', '.join(settings)}: would make several variants of this sweep equal; omit the setting, "
                "or change a copy of the sweep file"
            )
        raise InputError(f"{file}: two variants are the same experiment: {same.label}, {variant.label}")
    return tuple(distinct.values())


def _make_key(experiment: Experiment) -> str:
    """Return a key that is equal for experiments that differ only in where they are computed."""
    excluded = KEYS_OUTSIDE_RECORD - {"validate"}
    values = {key: value for key, value in experiment.to_mapping().items() if key not in excluded}
    return json.dumps(values, sort_keys=True, default=str)
