"""Settings of a sweep: whether any variant has what was set."""

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

from swarmwright.analysis.sweep.variants import Variant, changed
from swarmwright.common.errors import InputError
from swarmwright.common.yaml import dotted_path
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.settings import key_path, parse_settings


def require_effect(
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
        for leaf in leaves(path, setting.value) if grids else ():
            value = value_at(base, leaf)
            if all(value_at(one.experiment, leaf) != value for one in variants):
                raise InputError(
                    f"{setting.text}: no variant has this value of {dotted_path(leaf)}, because of "
                    f"'{_replacing(base, leaf, grids)}' in the grid; leave it out, or take the key out of "
                    "the grid"
                )


def leaves(path: tuple[str, ...], value: Any) -> Iterator[tuple[str, ...]]:  # noqa: ANN401 - as in a file
    """Yield the paths of what a setting sets: of all parts of a mapping."""
    if not isinstance(value, Mapping) or not value:
        yield path
        return
    for key, part in value.items():
        yield from leaves((*path, str(key)), part)


def value_at(experiment: Experiment, path: tuple[str, ...]) -> str | None:
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
            if value_at(changed(base, {key: values[0]}), path) != value_at(base, path):
                return key
    return next((key for key, _ in keys if _path(key)[0] == path[0]), keys[0][0])


def _path(key: str) -> tuple[str, ...]:
    """Return the parts of a key of the grid, whose names need no quotes there."""
    try:
        return key_path(f"{key}=")[0]
    except InputError:
        return tuple(key.split("."))
