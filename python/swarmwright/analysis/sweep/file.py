"""Sweep files, which define the variants of an experiment, their seeds and the folder of the results."""

from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Self

from swarmwright.analysis.sweep.recorded import is_record, load_recorded_sweep
from swarmwright.analysis.sweep.variants import (
    MOST_RUNS,
    Variant,
    apply_changes,
    are_seeds,
    create_variants,
    is_whole,
    leaves,
    value_at,
)
from swarmwright.common.errors import InputError
from swarmwright.common.files import suggest_file
from swarmwright.common.problems import format_value
from swarmwright.common.suggestions import unknown_key
from swarmwright.common.yaml import Source, format_path, read
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.settings import key_path, parse_settings
from swarmwright.runs.folders import RUNS
from swarmwright.runs.store.folder import check_sweep_folder


def require_effect(
    settings: Iterable[str],
    grid: Any,  # noqa: ANN401 - whatever the file says
    base: Experiment,
    variants: Iterable[Variant],
) -> None:
    """Raise InputError for a setting that the grid overrides in all variants.

    Args:
        settings: to check.
        grid: whose keys override settings.
        base: the experiment with the settings.
        variants: its variants.
    """
    grids = [entry for entry in (grid if isinstance(grid, list) else [grid]) if isinstance(entry, Mapping)]
    named = [{_path(str(key)): key for key in grid_of_list} for grid_of_list in grids]
    for setting in parse_settings(settings):
        path = setting.path
        # A section of the grid, such as `method`, keeps the options that it does not name.
        prefixes = [path[:length] for length in range(2, len(path) + 1)] or [path]
        keys = [next((paths[prefix] for prefix in prefixes if prefix in paths), None) for paths in named]
        if keys and None not in keys:
            raise InputError(
                f"{setting.text}: every variant has another value, of '{keys[0]}' in the grid; leave it out, "
                "or take the key out of the grid"
            )
        # Other keys can override it as well: a limit overrides other limits, a kind the options of a kind.
        for leaf in leaves(path, setting.value) if grids else ():
            value = value_at(base, leaf)
            if all(value_at(variant.experiment, leaf) != value for variant in variants):
                raise InputError(
                    f"{setting.text}: no variant has this value of {format_path(leaf)}, because of "
                    f"'{_find_overriding_key(base, leaf, grids)}' in the grid; remove the setting, or the "
                    "key from the grid"
                )


def _find_overriding_key(base: Experiment, path: tuple[str, ...], grids: Iterable[Mapping[Any, Any]]) -> str:
    """Return the key of the grid that changes an experiment's value at a path."""
    keys = [(str(key), values) for grid in grids for key, values in grid.items()]
    for key, values in keys:
        with suppress(InputError):  # it may be valid only together with other keys
            if value_at(apply_changes(base, {key: values[0]}), path) != value_at(base, path):
                return key
    return next((key for key, _ in keys if _path(key)[0] == path[0]), keys[0][0])


def _path(key: str) -> tuple[str, ...]:
    """Split a key of the grid, in which names need no quotes."""
    try:
        return key_path(f"{key}=")[0]
    except InputError:
        return tuple(key.split("."))


_KEYS = ("experiment", "grid", "seeds", "out")
_SEEDS = 5


@dataclass(frozen=True)
class Sweep:
    """The checked content of a sweep file: every variant can be run."""

    variants: tuple[Variant, ...]
    seeds: tuple[int, ...]
    out: Path
    file: Path | None = None
    settings: tuple[str, ...] = ()
    """Settings of all variants."""

    @classmethod
    def load(
        cls, path: str | PathLike[str], *, out: Path | None = None, settings: Iterable[str] = ()
    ) -> Self:
        """Read a sweep file (YAML), or the record of a sweep, sweep.json.

        Keys: `experiment`, the path of an experiment file, relative to the sweep file; `grid`, a mapping from
        keys of the experiment, as for `--set` (`method.population`, `method.measures.speed.bins`), to lists
        of values, whose combinations are the variants, or a list of such mappings, by default only the
        experiment itself; `seeds`, their number (1, 2, ..), or a list, by default 5; `out`, a folder relative
        to the working directory, by default runs/<name of the file>.

        A variant with another kind of method, controller or ranking is derived as with the settings of
        `Experiment.load`: it has that kind's defaults; a method keeps the experiment's target and limits
        (generations, except for racing; evaluations; seconds), and a ranking the options of all rankings. A
        limit of a variant replaces all limits of the experiment.

        The record of a sweep has the same variants and seeds, with the experiment and the code of the runs
        beside it. Its `out` is by default its own folder, so that missing runs are added there.

        Args:
            path: path of the file.
            out: overrides the file's.
            settings: as in `Experiment.load`, for all variants.

        Raises:
            InputError: the file or a variant is wrong, or code is not trusted.
        """
        file = Path(path)
        source = read(file)
        if source.problems:
            raise InputError("\n".join(f"{file}:{line}: {message}" for _, line, message in source.problems))
        if not isinstance(source.values, Mapping):
            raise InputError(
                f"{file}: is not a sweep file, which has a line such as 'experiment: minisim.yaml'"
            )
        settings = tuple(settings)
        for setting in parse_settings(settings):
            if setting.path == ("seed",):
                raise InputError(
                    f"{setting.text}: the sweep sets the seed of each run; use the key 'seeds' of {file}"
                )
        if is_record(source.values):
            return cls(**load_recorded_sweep(file, source.values, out, settings))
        return cls._check(source, file, out, settings)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], *, out: Path | None = None) -> Self:
        """Create a sweep from plain values with the keys of a file, see `load`.

        The experiment can be an `Experiment`, a mapping with its keys, or the path of its file. Without `out`
        the folder is runs/<simulation>-sweep.
        """
        plain = {
            key: value if key == "experiment" else _convert_to_lists(value) for key, value in values.items()
        }
        return cls._check(Source("", values=plain), None, out, ())

    @classmethod
    def _check(cls, source: Source, file: Path | None, out: Path | None, settings: Iterable[str]) -> Self:
        values = source.values
        if "simulation" in values and "experiment" not in values:
            raise InputError(
                f"{source.locate(())}is an experiment, not a sweep; run it with 'swarmwright optimize', or "
                "write a sweep file with a line such as 'experiment: minisim.yaml'"
            )
        for key in values:
            if key not in _KEYS:
                raise InputError(f"{source.locate((str(key),))}{unknown_key(str(key), _KEYS)}")
        settings = tuple(settings)
        experiment = _experiment(source, file, settings)
        seeds = _seeds(source)
        variants = create_variants(source, experiment)
        require_effect(settings, values.get("grid"), experiment, variants)
        if len(variants) * len(seeds) > MOST_RUNS:
            raise InputError(
                f"{source.locate(())}{len(variants)} variants with {len(seeds)} seeds each are too many "
                f"runs; the maximum is {MOST_RUNS}"
            )
        stem = f"{experiment.label}-sweep" if file is None else file.stem
        folder = out or _out(source, stem)
        check_sweep_folder(folder, "" if out is not None else source.locate(("out",)))
        return cls(variants, seeds, folder, file, settings)


def _convert_to_lists(value: Any) -> Any:  # noqa: ANN401 - any value
    """Convert all sequences and arrays in a value to lists, as in a file."""
    if isinstance(value, Mapping):
        return {key: _convert_to_lists(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple | range):
        return [_convert_to_lists(inner) for inner in value]
    return _convert_to_lists(value.tolist()) if hasattr(value, "tolist") else value


def _experiment(source: Source, file: Path | None, settings: Iterable[str]) -> Experiment:
    name = source.values.get("experiment")
    if file is None and isinstance(name, Experiment):
        return name
    if file is None and isinstance(name, Mapping):
        return Experiment.from_mapping(name)
    if file is None and isinstance(name, str | PathLike):
        return Experiment.load(name)
    if file is None:
        raise InputError(
            "experiment: must be an Experiment, a mapping with its keys, or the path of its file"
        )
    if not isinstance(name, str):
        raise InputError(f"{source.locate(('experiment',))}must be the path of an experiment file")
    path = file.parent / name
    if not path.is_file():
        raise InputError(f"{source.locate(('experiment',))}{path}: does not exist{suggest_file(path)}")
    return Experiment.load(path, settings)


def _seeds(source: Source) -> tuple[int, ...]:
    seeds = source.values.get("seeds", _SEEDS)
    if is_whole(seeds) and 1 <= seeds <= MOST_RUNS:
        return tuple(range(1, seeds + 1))
    if are_seeds(seeds):
        counts = Counter(seeds)
        if len(counts) < len(seeds):
            duplicate = next(seed for seed, count in counts.items() if count > 1)
            raise InputError(
                f"{source.locate(('seeds',))}the seed {duplicate} occurs twice; list each seed once, since "
                "runs with the same seed are identical"
            )
        return tuple(seeds)
    raise InputError(
        f"{source.locate(('seeds',))}must be a number of seeds (1, 2, ..), or a list of seeds (integers from "
        f"0), not {format_value(seeds)}"
    )


def _out(source: Source, stem: str) -> Path:
    out = source.values.get("out")
    if out is None:
        return RUNS / stem
    if not isinstance(out, str | PathLike) or not str(out):
        raise InputError(f"{source.locate(('out',))}must be the path of a folder, not {format_value(out)}")
    return Path(out)
