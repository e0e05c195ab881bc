"""Sweeps that are entered in a form: fields, the values of each, and seeds."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from swarmwright import InputError
from swarmwright.analysis.sweep.variants import MOST_RUNS
from swarmwright.common import yaml
from swarmwright.ui.entries import find_kinds, read_entries
from swarmwright.ui.fields import Form

MOST_FIELDS = 20
PLAIN = re.compile(r'[^.\[\]"=]+')
"""A part of a key of a grid that needs no quotes."""


@dataclass(frozen=True)
class Plan:
    """The variants of an experiment.

    Attributes:
        grid: the values of each key, named as for `--set`.
        seeds: their number.
        counts: of the values, in the order of the fields that were entered.
        errors: what is wrong with the entries of a field, by its number.
    """

    grid: Mapping[str, list[Any]]
    seeds: int
    counts: tuple[int, ...]
    errors: Mapping[int, str]

    @property
    def runs(self) -> int:
        """The number of runs."""
        runs = self.seeds
        for count in self.counts:
            runs *= count
        return runs

    def write(self, experiment: str) -> str:
        """Return the sweep file, for `swarmwright sweep`, of an experiment file."""
        return yaml.dump({"experiment": experiment, "grid": dict(self.grid), "seeds": self.seeds})


def plan_sweep(text: str, fields: list[Any], seeds: int, form: Form) -> Plan:
    """Return the variants that were entered.

    Args:
        text: of the experiment.
        fields: of each field `{path, values}`, where `values` are entered as `10, 20, 50`.
        seeds: number of seeds.
        form: of the experiment.

    Raises InputError for what is no such list, a field that is there twice, and too many runs.
    """
    find_kinds(text)  # it must be readable
    if not 1 <= len(fields) <= MOST_FIELDS:
        raise InputError(f"vary: choose 1 to {MOST_FIELDS} fields")
    if not 1 <= seeds <= MOST_RUNS:
        raise InputError(f"seeds: must be from 1 to {MOST_RUNS:,}")
    grid: dict[str, list[Any]] = {}
    errors = {}
    for index, entry in enumerate(fields):
        path, values = read_varied(entry)
        key = name_key(path)
        if key in grid:
            raise InputError(f"vary: {key} is there twice")
        if path == ("seed",):
            raise InputError("vary: seed: set the number of seeds instead")
        try:
            grid[key] = read_entries(values, form.field(path))
        except InputError as error:
            grid[key], errors[index] = [], str(error)
    plan = Plan(grid, seeds, tuple(map(len, grid.values())), errors)
    if plan.runs > MOST_RUNS:
        raise InputError(f"vary: makes {plan.runs:,} runs; at most {MOST_RUNS:,} are possible")
    return plan


def read_varied(entry: Any) -> tuple[tuple[str, ...], str]:  # noqa: ANN401 - JSON
    """Return the path and the values of a field that is varied. Raises InputError for anything else."""
    values = entry.get("values") if isinstance(entry, Mapping) else None
    if not isinstance(values, str):
        raise InputError("vary: must be a list of fields with path and values")
    return read_path(entry.get("path")), values


def read_path(path: Any) -> tuple[str, ...]:  # noqa: ANN401 - JSON
    """Return the path of a field. Raises InputError for anything else."""
    is_path = isinstance(path, list) and 1 <= len(path) <= 4 and all(isinstance(key, str) for key in path)
    if not is_path or any(len(key) > 200 for key in path):
        raise InputError("path: must list 1 to 4 keys of at most 200 characters")
    return tuple(path)


def name_key(path: tuple[str, ...]) -> str:
    """Return the name of a key as for `--set`. Raises InputError where it cannot be written."""
    if any('"' in key or not key for key in path):
        raise InputError(f"vary: {yaml.format_path(path)[:100]}: a key with quotes cannot be varied")
    return ".".join(key if PLAIN.fullmatch(key) else f'"{key}"' for key in path)
