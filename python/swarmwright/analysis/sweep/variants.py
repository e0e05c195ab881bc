"""Variants of a sweep: the combinations of its grid, and the names of their folders."""

import copy
import hashlib
import itertools
import json
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeGuard

from swarmwright.analysis.labels import label_alone, labels_of, name_of
from swarmwright.common.errors import InputError
from swarmwright.common.problems import format_value
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.yaml import Source
from swarmwright.experiment.budget import LIMITS, sets_limit
from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD, Experiment
from swarmwright.experiment.settings import assign, key_path, list_kept_options
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.simulations.names import make_absolute
from swarmwright.simulations.user_code.copying import display_name

MOST_RUNS = 100_000
_CLASSES = ("simulation", "method", "method.kind", "ranking", "ranking.kind")
"""Keys whose value may be a class in a file, relative to the sweep file."""
_DIGITS = 6
"""Number of hexadecimal digits of a variant's digest in the name of its folder."""


@dataclass(frozen=True, eq=False)
class Variant:
    """A variant of the experiment."""

    label: str
    """Description of its differences."""
    folder: str
    """Unique part of a file name, from its values."""
    experiment: Experiment
    """The experiment with the seed of the file; runs have other seeds."""
    alike: str = ""
    """Folder name that it would share with other variants; empty if its name is unique."""
    apart: str = ""
    """Unique name instead, with a digest of its values."""
    keys: tuple[str, ...] = ()
    """Keys that the grid sets."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Names in the record for code that is used from the copy of a run."""


def create_variants(source: Source, base: Experiment) -> tuple[Variant, ...]:
    """Create the variants of a sweep file's experiment.

    Raises InputError when the grid or a variant is wrong.
    """
    if "grid" not in source.values:
        label = name_of(base)
        return (Variant(label, _file_name(label), base),)
    grid = source.values["grid"]
    grids = grid if isinstance(grid, list) and grid else [grid]
    combinations = []
    for index, entry in enumerate(grids):
        path = ("grid", index) if isinstance(grid, list) and grid else ("grid",)
        combinations += [(path, changes) for changes in _combine_values(source, entry, path)]
    kinds = {f"{section}.kind": getattr(base, section).kind for section in REGISTRIES}
    every = [changes for _, changes in combinations]
    labels = labels_of(every, [{**kinds, **changes} for changes in every])
    variants: dict[Experiment, tuple[str, dict[str, Any], Experiment]] = {}  # grids may overlap
    for (path, changes), label in zip(combinations, labels, strict=True):
        try:
            experiment = apply_changes(base, _resolve_files(changes, source.folder(path)))
        except InputError as error:
            raise InputError(f"{source.locate(path)}with {label}: {error}") from error
        if experiment not in variants:
            variants[experiment] = (label, changes, experiment)
    return _with_folders(variants.values())


def _resolve_files(changes: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Resolve classes in files among the values of a grid relative to a folder."""
    return {
        key: make_absolute(value, folder) if key in _CLASSES and isinstance(value, str) else value
        for key, value in changes.items()
    }


def _combine_values(source: Source, grid: Any, at: tuple[Any, ...]) -> list[dict[str, Any]]:  # noqa: ANN401
    """Return all combinations of a grid's values."""
    if not isinstance(grid, Mapping) or not grid:
        raise InputError(
            f"{source.locate(at)}must be a mapping from keys of the experiment to lists of values, such as "
            "method.population: [20, 50]"
        )
    for key, values in grid.items():
        if not isinstance(values, list) or not values:
            raise InputError(
                f"{source.locate((*at, key))}must be a list of values, not {format_value(values)}"
            )
        if key == "seed":
            raise InputError(f"{source.locate((*at, key))}seeds cannot be in the grid; use the key 'seeds'")
        section, _, option = str(key).partition(".")
        if option and section in grid:
            raise InputError(
                f"{source.locate((*at, key))}the grid also sets all of '{section}'; remove one of the two"
            )
        whole = next(
            (prefix for prefix in map(str, grid) if "." in prefix and str(key).startswith(f"{prefix}.")), None
        )
        if whole is not None:
            raise InputError(
                f"{source.locate((*at, key))}the grid also sets all of '{whole}'; remove one of the two"
            )
    count = math.prod(map(len, grid.values()))
    if count > MOST_RUNS:
        raise InputError(f"{source.locate(at)}has {count} variants; the maximum is {MOST_RUNS}")
    return [dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values())]


def apply_changes(base: Experiment, changes: Mapping[str, Any]) -> Experiment:
    """Apply changes to an experiment: kinds first, since options depend on them; parts of options last."""
    merged: dict[str, Any] = {}
    paths = {key: _path_of(base, key) for key in changes}
    for key, path in sorted(
        paths.items(), key=lambda item: (not item[0].endswith(".kind"), item[1] if len(item[1]) > 2 else ())
    ):
        value = changes[key]
        section = path[0]
        if len(path) == 1:
            merged[section] = value
            continue
        if section not in merged:
            merged[section] = {}
        if path[1:] == ("kind",) and section in REGISTRIES:
            merged[section].update(_select_kept_options(base, section, value, changes))
        if len(path) == 2:
            merged[section][path[1]] = value
        else:
            _set_part(base, merged[section], path, value)
    return base.replace(**merged)


def _path_of(base: Experiment, key: str) -> tuple[str, ...]:
    """Return the path of a key, such as `method.measures.steps.bins` or `parameters."a.b"`."""
    section, _, option = key.partition(".")
    if not set('."[') & set(option) or (section == "parameters" and option in base.parameters):
        return (section, option) if option else (section,)
    return key_path(f"{key}=")[0]


def _set_part(base: Experiment, merged: dict[str, Any], path: tuple[str, ...], value: Any) -> None:  # noqa: ANN401
    """Set a part of an option; its other parts are kept unless the variant has another kind."""
    section, option = path[:2]
    values = base.to_mapping()
    options = values.get(section)
    same_kind = isinstance(options, dict) and merged.get("kind", options.get("kind")) == options.get("kind")
    old_value = options.get(option) if isinstance(options, dict) and same_kind else None
    values[section] = {option: copy.deepcopy(merged.get(option, old_value))}
    assign(values, path, value)
    merged[option] = values[section][option]


def _select_kept_options(
    base: Experiment,
    section: str,
    kind: Any,  # noqa: ANN401
    changes: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the options in the experiment's file that a variant of another kind keeps, as with --set."""
    options = getattr(base, section)
    if kind == options.kind:
        return {}
    names = set(list_kept_options(section, kind))
    options_set = {key.removeprefix("method."): change for key, change in changes.items()}
    if section == "method" and sets_limit(options_set):
        names -= set(LIMITS)
    # Defaults are not kept, since another kind has other defaults.
    old = options.model_dump(exclude_none=True, exclude_unset=True)
    return {name: value for name, value in old.items() if name in names}


def _file_name(label: str) -> str:
    safe = "".join(sign if sign.isalnum() or sign in "-.+" else "_" for sign in label)
    while "__" in safe:
        safe = safe.replace("__", "_")
    return safe.strip("_.")[:80] or "variant"


def _with_folders(entries: Iterable[tuple[str, Mapping[str, Any], Experiment]]) -> tuple[Variant, ...]:
    """Return variants with unique names of their folders.

    A name depends only on the variant's own values, so that it stays when values are added to the grid. If
    several variants would have the same name, since long values are truncated, all except the first have a
    digest of their values in it.

    Args:
        entries: label, values and experiment of each.
    """
    named = [
        (_file_name(label_alone(values)), label, values, experiment) for label, values, experiment in entries
    ]
    counts = Counter(name for name, *_ in named)
    used_names = set(counts)
    variants = []
    first = set(counts)
    for name, label, values, experiment in named:
        if counts[name] == 1:
            variants.append(Variant(label, name, experiment, keys=tuple(values)))
            continue
        apart = _with_digest(name, values, used_names)
        used_names.add(apart)
        folder = name if name in first else apart
        variants.append(Variant(label, folder, experiment, name, apart, tuple(values)))
        first.discard(name)
    return tuple(variants)


def _with_digest(name: str, values: Mapping[str, Any], used_names: Collection[str]) -> str:
    """Return a name with a digest of the values: six digits, or more until the name is unused."""
    text = json.dumps(values, default=str, ensure_ascii=False)
    digest = hashlib.sha256(text.encode()).hexdigest()
    lengths = range(_DIGITS, len(digest) + 1)
    return next(free for length in lengths if (free := f"{name}-{digest[:length]}") not in used_names)


def leaves(path: tuple[str, ...], value: Any) -> Iterator[tuple[str, ...]]:  # noqa: ANN401 - as in a file
    """Yield the paths that a setting sets, one for each part of a mapping."""
    if not isinstance(value, Mapping) or not value:
        yield path
        return
    for key, part in value.items():
        yield from leaves((*path, str(key)), part)


def value_at(experiment: Experiment, path: tuple[str, ...]) -> str | None:
    """Return an experiment's value at a path as text; None if there is none."""
    value: Any = experiment.to_mapping()
    for part in path:
        if isinstance(value, Mapping) and part in value:
            value = value[part]
        elif isinstance(value, list | tuple) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        else:
            return None
    return json.dumps(value, sort_keys=True, default=str)


def are_seeds(value: Any) -> TypeGuard[list[int]]:  # noqa: ANN401 - whatever a file says
    """Return whether a value is a list of seeds, possibly with duplicates."""
    return isinstance(value, list) and bool(value) and all(is_whole(seed) and seed >= 0 for seed in value)


def is_whole(value: Any) -> bool:  # noqa: ANN401 - whatever the file says
    """Return whether a value is an integer."""
    return isinstance(value, int) and not isinstance(value, bool)


_IRRELEVANT_KEYS = KEYS_OUTSIDE_RECORD | {"sensors", "actuators"}
"""Keys that say where to compute, or that a server may have announced."""


def comparable(experiment: Experiment) -> dict[str, Any]:
    """Return the keys of an experiment that must be equal in its runs: all except the limits."""
    values: dict[str, Any] = {
        key: value for key, value in experiment.to_mapping().items() if key not in _IRRELEVANT_KEYS
    }
    parsed = SimulationName.parse(experiment.simulation)
    if parsed.is_command:
        values["simulation"] = parsed.with_file(SimulationName.DEFINITION)
    else:
        # A copied module is a file; `display_name` is its name in the experiment: package.module:Class.
        named = SimulationName.parse(display_name(experiment.simulation))
        # The same file in any folder: `describe_code_changes` compares its content.
        values["simulation"] = named.text if named.file is None else named.with_file(named.file.name)
    for key in ("method", "ranking"):
        kind = SimulationName.parse(display_name(values[key]["kind"]))
        if kind.file is not None:  # likewise
            values[key] = {**values[key], "kind": kind.with_file(kind.file.name)}
    values["method"] = {key: value for key, value in values["method"].items() if key not in LIMITS}
    plain: dict[str, Any] = json.loads(json.dumps(values, default=str))  # with lists in place of tuples
    return plain
