"""Sweep files: which variants of an experiment, with which seeds, where the results go."""

import copy
import hashlib
import itertools
import json
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from swarmwright.analysis.labels import label_alone, labels_of, name_of
from swarmwright.core.errors import InputError
from swarmwright.core.problems import shown
from swarmwright.core.suggestions import did_you_mean
from swarmwright.core.yaml import Source, dotted_path, read
from swarmwright.experiment.budget import LIMITS, sets_limit
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.settings import assign, kept_options, key_path, parse_settings
from swarmwright.plug_ins import REGISTRIES
from swarmwright.runs.folders import RUNS

_KEYS = ("experiment", "grid", "seeds", "out")
_SEEDS = 5
_MOST_RUNS = 100_000
_DIGITS = 6
"""Hexadecimal digits of a variant's digest in the name of its folder."""


@dataclass(frozen=True, eq=False)
class Variant:
    """One variant of the experiment."""

    label: str
    """What distinguishes it, in words."""
    folder: str
    """Its values as part of a file name, no other variant's."""
    experiment: Experiment
    """With the seed of the file; the seeds of runs differ."""
    alike: str = ""
    """The name that its folder and those of other variants would have; empty where no other would."""
    apart: str = ""
    """A name instead of that, with a digest of its values."""


@dataclass(frozen=True)
class Sweep:
    """What a sweep file says, checked: every variant can be run."""

    variants: tuple[Variant, ...]
    seeds: tuple[int, ...]
    out: Path
    file: Path | None = None
    settings: tuple[str, ...] = ()
    """What was set for all variants."""

    @classmethod
    def load(cls, path: str | Path, *, out: Path | None = None, settings: Iterable[str] = ()) -> Self:
        """Read a sweep file (YAML).

        Keys: `experiment`, the path of an experiment file, relative to the sweep file; `grid`, a mapping from
        keys of the experiment, as for `--set` (`method.population`, `method.measures.speed.bins`), to lists
        of values, of which every combination is a variant, or a list of such mappings, default: the
        experiment alone; `seeds`, how many (1, 2, ..), or a list, default 5; `out`, a folder, relative to
        where the program is started, default runs/<name of the file>.

        A variant with another kind of method, controller or ranking than the experiment is what the settings
        of `Experiment.load` would make of it: it has that kind's defaults; a method keeps the experiment's
        target and limits (generations, not for racing; evaluations; seconds), a ranking what all rankings
        have. A limit of a variant takes the place of all limits of the experiment.

        Args:
            path: of the file.
            out: instead of the file's.
            settings: as in `Experiment.load`, for all variants.

        Raises:
            InputError: the file or a variant is wrong; the message says where.
        """
        file = Path(path)
        source = read(file)
        if source.problems:
            raise InputError("\n".join(f"{file}:{line}: {what}" for _, line, what in source.problems))
        if not isinstance(source.values, Mapping):
            raise InputError(
                f"{file}: is not a sweep file; a sweep file begins like 'experiment: minisim.yaml'"
            )
        return cls._checked(source, file, out, settings)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], *, out: Path | None = None) -> Self:
        """Make a sweep of plain values with the keys of a file, see `load`.

        The experiment can be an `Experiment`, a mapping with its keys, or the path of its file. Without `out`
        the folder is runs/<simulation>-sweep.
        """
        plain = {key: value if key == "experiment" else _listed(value) for key, value in values.items()}
        return cls._checked(Source("", values=plain), None, out, ())

    @classmethod
    def _checked(cls, source: Source, file: Path | None, out: Path | None, settings: Iterable[str]) -> Self:
        values = source.values
        if "simulation" in values and "experiment" not in values:
            raise InputError(
                f"{source.place(())}is an experiment, which 'swarmwright optimize' runs; a sweep file begins "
                "like 'experiment: minisim.yaml'"
            )
        for key in values:
            if key not in _KEYS:
                raise InputError(f"{source.place((str(key),))}unknown key{did_you_mean(str(key), _KEYS)}")
        settings = tuple(settings)
        experiment = _experiment(source, file, settings)
        seeds = _seeds(source)
        variants = _variants(source, experiment)
        _require_effect(settings, values.get("grid"), experiment, variants)
        if len(variants) * len(seeds) > _MOST_RUNS:
            raise InputError(
                f"{source.place(())}{len(variants)} variants with {len(seeds)} seeds each are too many runs, "
                f"at most {_MOST_RUNS} are possible"
            )
        stem = f"{experiment.label}-sweep" if file is None else file.stem
        return cls(variants, seeds, out or _out(source, stem), file, settings)


def _listed(value: Any) -> Any:  # noqa: ANN401 - any value
    """Return a value in which whatever is a sequence or an array is a list, as in a file."""
    if isinstance(value, Mapping):
        return {key: _listed(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | range):
        return [_listed(inner) for inner in value]
    return _listed(value.tolist()) if hasattr(value, "tolist") else value


def _experiment(source: Source, file: Path | None, settings: Iterable[str]) -> Experiment:
    name = source.values.get("experiment")
    if file is None and isinstance(name, Experiment):
        return name
    if file is None and isinstance(name, Mapping):
        return Experiment.from_mapping(name)
    if file is None and isinstance(name, str | Path):
        return Experiment.load(name)
    if file is None:
        raise InputError(
            "experiment: must be an Experiment, a mapping with its keys, or the path of its file"
        )
    if not isinstance(name, str):
        raise InputError(f"{source.place(('experiment',))}must be the path of an experiment file")
    path = file.parent / name
    if not path.is_file():
        raise InputError(f"{source.place(('experiment',))}{path}: there is no such file")
    return Experiment.load(path, settings)


def _require_effect(
    settings: Iterable[str],
    grid: Any,  # noqa: ANN401 - whatever the file says
    base: Experiment,
    variants: Iterable[Variant],
) -> None:
    """Raise InputError for a setting that no variant would have, since each has a value of the grid.

    Args:
        settings: what is set.
        grid: whose keys take the place of settings.
        base: the experiment with the settings.
        variants: of it.
    """
    grids = [one for one in (grid if isinstance(grid, list) else [grid]) if isinstance(one, Mapping)]
    named = [{_path(str(key)): key for key in one} for one in grids]
    for setting in parse_settings(settings):
        path = setting.path
        # A section of the grid, such as `method`, keeps the options that it does not name.
        replaced = [path[:length] for length in range(2, len(path) + 1)] or [path]
        keys = [next((one[part] for part in replaced if part in one), None) for one in named]
        if keys and None not in keys:
            raise InputError(
                f"{setting.text}: every variant has another value, of '{keys[0]}' in the grid; leave it out, "
                "or take the key out of the grid"
            )
        # Other keys can replace it as well: a limit all other limits, another kind the options of a kind.
        for leaf in _leaves(path, setting.value) if grids else ():
            value = _value(base, leaf)
            if all(_value(one.experiment, leaf) != value for one in variants):
                raise InputError(
                    f"{setting.text}: no variant has this value of {dotted_path(leaf)}, because of "
                    f"'{_replacing(base, leaf, grids)}' in the grid; leave it out, or take the key out of "
                    "the grid"
                )


def _leaves(path: tuple[str, ...], value: Any) -> Iterator[tuple[str, ...]]:  # noqa: ANN401 - as in a file
    """Yield the paths of what a setting sets: of all parts of a mapping."""
    if not isinstance(value, Mapping) or not value:
        yield path
        return
    for key, part in value.items():
        yield from _leaves((*path, str(key)), part)


def _value(experiment: Experiment, path: tuple[str, ...]) -> str | None:
    """Return what an experiment has at a path, as text; None where there is nothing."""
    value: Any = experiment.to_mapping()
    for part in path:
        if isinstance(value, Mapping) and part in value:
            value = value[part]
        elif isinstance(value, list | tuple) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        else:
            return None
    return json.dumps(value, sort_keys=True, default=str)


def _replacing(base: Experiment, path: tuple[str, ...], grids: Iterable[Mapping[Any, Any]]) -> str:
    """Return the key of the grid by which an experiment has another value at a path."""
    keys = [(str(key), values) for one in grids for key, values in one.items()]
    for key, values in keys:
        with suppress(InputError):  # it may be possible only together with other keys
            if _value(_changed(base, {key: values[0]}), path) != _value(base, path):
                return key
    return next((key for key, _ in keys if _path(key)[0] == path[0]), keys[0][0])


def _path(key: str) -> tuple[str, ...]:
    """Return the parts of a key of the grid, whose names need no quotes there."""
    try:
        return key_path(f"{key}=")[0]
    except InputError:
        return tuple(key.split("."))


def _seeds(source: Source) -> tuple[int, ...]:
    seeds = source.values.get("seeds", _SEEDS)
    if _whole(seeds) and 1 <= seeds <= _MOST_RUNS:
        return tuple(range(1, seeds + 1))
    if isinstance(seeds, list) and seeds and all(_whole(seed) and seed >= 0 for seed in seeds):
        counts = Counter(seeds)
        if len(counts) < len(seeds):
            twice = next(seed for seed, count in counts.items() if count > 1)
            raise InputError(
                f"{source.place(('seeds',))}the seed {twice} is there twice; runs with the same seed are the "
                "same, so name each seed once"
            )
        return tuple(seeds)
    raise InputError(
        f"{source.place(('seeds',))}must be a number of seeds, from 1 on, or a list of seeds, which are "
        f"whole numbers from 0 on, not {shown(seeds)}"
    )


def _whole(value: Any) -> bool:  # noqa: ANN401 - whatever the file says
    return isinstance(value, int) and not isinstance(value, bool)


def _out(source: Source, stem: str) -> Path:
    out = source.values.get("out")
    if out is None:
        return RUNS / stem
    if not isinstance(out, str | Path) or not str(out):
        raise InputError(f"{source.place(('out',))}must be the path of a folder, not {shown(out)}")
    return Path(out)


def _variants(source: Source, base: Experiment) -> tuple[Variant, ...]:
    if "grid" not in source.values:
        label = name_of(base)
        base.check_new()
        return (Variant(label, _file_name(label), base),)
    grid = source.values["grid"]
    grids = grid if isinstance(grid, list) and grid else [grid]
    combinations = []
    for index, one in enumerate(grids):
        at = ("grid", index) if isinstance(grid, list) and grid else ("grid",)
        combinations += [(at, changes) for changes in _combinations(source, one, at)]
    labels = labels_of([changes for _, changes in combinations])
    found: dict[Experiment, tuple[str, dict[str, Any], Experiment]] = {}  # grids may overlap
    for (at, changes), label in zip(combinations, labels, strict=True):
        try:
            experiment = _changed(base, changes)
            experiment.check_new()
        except InputError as error:
            raise InputError(f"{source.place(at)}with {label}: {error}") from error
        if experiment not in found:
            found[experiment] = (label, changes, experiment)
    return _with_folders(found.values())


def _combinations(source: Source, grid: Any, at: tuple[Any, ...]) -> list[dict[str, Any]]:  # noqa: ANN401
    """Return every combination of a grid's values."""
    if not isinstance(grid, Mapping) or not grid:
        raise InputError(
            f"{source.place(at)}must be a mapping from keys of the experiment to lists of values, such as "
            "method.population: [20, 50]"
        )
    for key, values in grid.items():
        if not isinstance(values, list) or not values:
            raise InputError(f"{source.place((*at, key))}must be a list of values, not {shown(values)}")
        if key == "seed":
            raise InputError(
                f"{source.place((*at, key))}seeds do not belong to the grid; see the key 'seeds'"
            )
        section, _, option = str(key).partition(".")
        if option and section in grid:
            raise InputError(
                f"{source.place((*at, key))}the grid names the whole of '{section}', too; name one of the two"
            )
        whole = next((one for one in map(str, grid) if "." in one and str(key).startswith(f"{one}.")), None)
        if whole is not None:
            raise InputError(
                f"{source.place((*at, key))}the grid names the whole of '{whole}', too; name one of the two"
            )
    count = math.prod(map(len, grid.values()))
    if count > _MOST_RUNS:
        raise InputError(f"{source.place(at)}makes {count} variants; at most {_MOST_RUNS} are possible")
    return [dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values())]


def _changed(base: Experiment, changes: Mapping[str, Any]) -> Experiment:
    """Return the experiment with changed keys: kinds first, others may be theirs; parts of options last."""
    merged: dict[str, Any] = {}
    for key in sorted(changes, key=lambda key: (not key.endswith(".kind"), _part_of_option(base, key) or ())):
        value = changes[key]
        section, _, option = key.partition(".")
        if not option:
            merged[section] = value
            continue
        if section not in merged:
            merged[section] = {}
        if option == "kind" and section in REGISTRIES:
            merged[section].update(_kept(base, section, value, changes))
        path = _part_of_option(base, key)
        if path is None:
            merged[section][option] = value
        else:
            _set_part(base, merged[section], path, value)
    return base.replace(**merged)


def _part_of_option(base: Experiment, key: str) -> tuple[str, ...] | None:
    """Return the path of a key that names a part of an option, `method.measures.steps.bins`; else None."""
    section, _, option = key.partition(".")
    if not ("." in option or "[" in option) or (section == "parameters" and option in base.parameters):
        return None
    path = key_path(f"{key}=")[0]
    return path if len(path) > 2 else None


def _set_part(base: Experiment, merged: dict[str, Any], path: tuple[str, ...], value: Any) -> None:  # noqa: ANN401
    """Set a part of an option, the rest of which is kept unless the variant has another kind."""
    section, option = path[:2]
    values = base.to_mapping()
    options = values.get(section)
    same_kind = isinstance(options, dict) and merged.get("kind", options.get("kind")) == options.get("kind")
    kept = options.get(option) if isinstance(options, dict) and same_kind else None
    values[section] = {option: copy.deepcopy(merged.get(option, kept))}
    assign(values, path, value)
    merged[option] = values[section][option]


def _kept(base: Experiment, section: str, kind: Any, changes: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ANN401
    """Return the options of the experiment's file that a variant with another kind keeps, as with --set."""
    options = getattr(base, section)
    if kind == options.kind:
        return {}
    names = set(kept_options(section, kind))
    given = {key.removeprefix("method."): change for key, change in changes.items()}
    if section == "method" and sets_limit(given):
        names -= set(LIMITS)
    # Defaults are not kept: another kind has other ones.
    old = options.model_dump(exclude_none=True, exclude_unset=True)
    return {name: value for name, value in old.items() if name in names}


def _file_name(label: str) -> str:
    safe = "".join(sign if sign.isalnum() or sign in "-.+" else "_" for sign in label)
    while "__" in safe:
        safe = safe.replace("__", "_")
    return safe.strip("_.")[:80] or "variant"


def _with_folders(found: Iterable[tuple[str, Mapping[str, Any], Experiment]]) -> tuple[Variant, ...]:
    """Return variants with the names of their folders, of which no two are the same.

    A name depends on the variant's own values alone, so that it stays when values are added to the grid. Of
    variants that would have one name, since long values are cut, all but the first have a digest of their
    values in it.

    Args:
        found: label, values and experiment of each.
    """
    named = [
        (_file_name(label_alone(values)), label, values, experiment) for label, values, experiment in found
    ]
    counts = Counter(name for name, *_ in named)
    taken = set(counts)
    variants = []
    first = set(counts)
    for name, label, values, experiment in named:
        if counts[name] == 1:
            variants.append(Variant(label, name, experiment))
            continue
        apart = _apart(name, values, taken)
        taken.add(apart)
        variants.append(Variant(label, name if name in first else apart, experiment, name, apart))
        first.discard(name)
    return tuple(variants)


def _apart(name: str, values: Mapping[str, Any], taken: Collection[str]) -> str:
    """Return a name with a digest of the values, of six digits unless that is taken."""
    text = json.dumps(values, default=str, ensure_ascii=False)
    digest = hashlib.sha256(text.encode()).hexdigest()
    lengths = range(_DIGITS, len(digest) + 1)
    return next(free for length in lengths if (free := f"{name}-{digest[:length]}") not in taken)
