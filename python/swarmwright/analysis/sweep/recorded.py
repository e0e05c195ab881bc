"""Sweeps that are repeated or completed by the record that they wrote beside their runs, `sweep.json`."""

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
from swarmwright.experiment.experiment import ELSEWHERE, Experiment, recorded_experiment
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
    """What is used of simulations, behaviours and conditions, by what the record calls them."""
    runs: dict[str, tuple[str, Run]] = field(default_factory=dict)
    """The SHA-256 of a simulation's code, and a run that was computed with it, likewise."""
    copies: dict[tuple[str, str], str] = field(default_factory=dict)
    """Simulations that are used, by what people call them and their code: equal ones are one simulation."""


def is_record(values: Any) -> bool:  # noqa: ANN401 - whatever a file says
    """Return whether a file is the record of a sweep, rather than a sweep file."""
    return (
        isinstance(values, Mapping)
        and "variants" in values
        and ("settings" in values or isinstance(values["variants"], list))
        and not values.keys() & {"grid", "out"}
    )


def sweep_of(
    file: Path, values: Mapping[str, Any], out: Path | None, settings: Iterable[str]
) -> dict[str, Any]:
    """Return the fields of a `Sweep`, as the record of one has them.

    A variant is what its runs beside the record hold, with the code that they were computed with. One without
    a run is what the record says, with the code of other variants' runs; without any, with the code that the
    record names, if that is trusted.

    Args:
        file: the record.
        values: that it holds.
        out: folder for the runs; default: the record's, where those that are missing are run.
        settings: as in `Experiment.load`, for all variants.

    Raises:
        InputError: the file is not such a record, a variant cannot be used here, its code is not trusted, a
            run is not of its variant, runs were computed with different code, or a setting would make
            variants the same.
    """
    settings = tuple(settings)
    try:
        seeds = _seeds(values["seeds"])
        earlier = _texts(values["settings"], "settings")
        name = None if values["file"] is None else Path(values["file"])
        found = [
            (
                str(variant["label"]),
                _folder(names_of(variant["runs"]), seeds),
                {**values["experiment"], **variant["experiment"]},
                _texts(variant["keys"], "keys"),
            )
            for variant in values["variants"]
        ]
        if not found:
            raise ValueError("variants: none")
    except (ValueError, KeyError, TypeError, IndexError) as error:
        what = f"without the key {error}" if isinstance(error, KeyError) else error
        raise InputError(
            f"{file}: is not a record of a sweep as Swarmwright writes it ({what}); start the sweep with its "
            "sweep file"
        ) from error
    runs = [_first_readable(file.parent / f"{folder}-{seed}" for seed in seeds) for _, folder, *_ in found]
    code = _Code()
    variants: dict[int, Variant] = {}
    for place in sorted(range(len(found)), key=lambda place: runs[place] is None):
        label, folder, kept, keys = found[place]
        run = runs[place]
        try:
            recorded = recorded_experiment(kept)
            experiment = _without_run(kept, recorded, code) if run is None else _of_run(run, recorded, code)
        except InputError as error:
            raise InputError(f"{file}: {label}: {error}") from error
        called = dict(zip(_names(experiment), _names(recorded), strict=True))
        variants[place] = Variant(label, folder, experiment, keys=keys, names=called)
    return {
        "variants": _changed(file, [variants[place] for place in range(len(found))], settings),
        "seeds": seeds,
        "out": out or file.parent,
        "file": name,
        "settings": (*earlier, *settings),
    }


def with_names(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Return the keys of an experiment with other names of its simulation and of plug-ins in files."""
    changed = {**values, "simulation": _named(values["simulation"], names)}
    for key in _CLASSES:
        section = values.get(key)
        if isinstance(section, Mapping) and "kind" in section:
            changed[key] = {**section, "kind": _named(section["kind"], names)}
    controller = values.get("controller")
    if isinstance(controller, Mapping):
        lists = {key: controller[key] for key in _MODULES if isinstance(controller.get(key), list)}
        changed["controller"] = {
            **controller,
            **{key: [_named(module, names) for module in found] for key, found in lists.items()},
        }
    return changed


def _named(name: Any, names: Mapping[str, str]) -> Any:  # noqa: ANN401 - whatever a file says
    return names.get(name, name) if isinstance(name, str) else name


def _names(experiment: Experiment) -> list[str]:
    """Return the names of an experiment's simulation, and of what may be plug-ins in files."""
    lists = (getattr(experiment.controller, key, None) for key in _MODULES)
    modules = (name for listed in lists if isinstance(listed, list | tuple) for name in listed)
    return [experiment.simulation, *(getattr(experiment, key).kind for key in _CLASSES), *modules]


def _seeds(seeds: Any) -> tuple[int, ...]:  # noqa: ANN401 - whatever a file says
    if not are_seeds(seeds) or len(set(seeds)) < len(seeds):
        raise ValueError("seeds: not a list of different whole numbers from 0 on")
    return tuple(seeds)


def _texts(texts: Any, key: str) -> tuple[str, ...]:  # noqa: ANN401 - whatever a file says
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise ValueError(f"{key}: not a list of texts")
    return tuple(texts)


def _folder(names: Sequence[str], seeds: Sequence[int]) -> str:
    """Return the name of a variant's folders without the seed. Raises ValueError where there is none."""
    folder = names[0].removesuffix(f"-{seeds[0]}")
    if not folder or list(names) != [f"{folder}-{seed}" for seed in seeds]:
        raise ValueError("runs: not a folder for each seed")
    return folder


def _without_run(values: Mapping[str, Any], recorded: Experiment, code: _Code) -> Experiment:
    """Return the experiment of a variant without a run.

    Args:
        values: of the record.
        recorded: the same, without its code.
        code: of other variants' runs.

    Raises InputError where code that the record names is not trusted, or the experiment cannot be used.
    """
    simulation, *modules = _names(recorded)
    if simulation not in code.used and is_python(simulation):
        require_named(simulation)
    for name in modules:
        if name not in code.used and is_in_file(name):
            require_file(name)
    return Experiment.from_mapping(with_names(values, code.used))


def _of_run(run: Run, recorded: Experiment, code: _Code) -> Experiment:
    """Return the experiment of a variant as a run of it holds it, and note its code.

    Raises InputError where the run is of another experiment, its code is not trusted, or was not that of
    other runs of the simulation.
    """
    differing = [
        difference
        for difference in differences(comparable(run.experiment), comparable(recorded))
        if difference.key != "seed"
    ]
    if differing:
        raise InputError(
            f"{run.path}: holds a run of another experiment: {', '.join(map(str, differing))}; move it "
            "elsewhere"
        )
    experiment = resolve_experiment(run)
    simulation = experiment.simulation
    copy = find_copy(run)
    if copy is not None and "simulation" in copy.parts:
        digest = compute_digest({"simulation": copy.parts["simulation"].digests})
        known, other = code.runs.setdefault(recorded.simulation, (digest, run))
        if known != digest:
            raise InputError(
                f"{run.path}: the code of {display_name(simulation)} is not that of {other.path}. Runs of "
                "different code cannot be compared; move those of one of the two elsewhere"
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
    for name, used in zip(_names(recorded), _names(experiment), strict=True):
        code.used.setdefault(name, used)
    return experiment


def _first_readable(folders: Iterable[Path]) -> Run | None:
    """Return the first run that is there and can be read."""
    for folder in folders:
        with suppress(InputError):  # a damaged one is named when it is its turn
            if (folder / STORE).exists():
                return Run.open(folder)
    return None


def _changed(file: Path, variants: Sequence[Variant], settings: Sequence[str]) -> tuple[Variant, ...]:
    """Return variants with settings. Raises InputError where these concern what differs between them."""
    experiments = [variant.experiment for variant in variants]
    for setting in parse_settings(settings):
        for leaf in leaves(setting.path, setting.value):
            if len({value_at(experiment, leaf) for experiment in experiments}) > 1:
                raise InputError(
                    f"{setting.text}: the variants of this sweep differ in {format_path(leaf)}; leave it "
                    "out, or change a copy of the sweep file"
                )
    found: dict[str, Variant] = {}
    for variant in variants:
        changed = dataclasses.replace(variant, experiment=variant.experiment.with_settings(settings))
        same = found.setdefault(_asked(changed.experiment), changed)
        if same is changed:
            continue
        if settings:
            raise InputError(
                f"{', '.join(settings)}: several variants of this sweep would be the same experiment; leave "
                "it out, or change a copy of the sweep file"
            )
        raise InputError(f"{file}: two variants are the same experiment: {same.label}, {variant.label}")
    return tuple(found.values())


def _asked(experiment: Experiment) -> str:
    """Return what an experiment asks for, wherever it is computed."""
    left_out = ELSEWHERE - {"validate"}
    values = {key: value for key, value in experiment.to_mapping().items() if key not in left_out}
    return json.dumps(values, sort_keys=True, default=str)
