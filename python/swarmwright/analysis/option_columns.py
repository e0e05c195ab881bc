"""Columns of tables for the keys in which experiments differ: options of different kinds are not mixed."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from swarmwright.methods import MethodOptions
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.methods.rankings import RankingOptions

_OF_ALL_KINDS = {
    "method": frozenset(MethodOptions.model_fields),
    "ranking": frozenset(RankingOptions.model_fields),
}
"""Options that mean the same whatever the kind is."""


def option_columns(rows: Sequence[tuple[Mapping[str, Any], Collection[str]]]) -> list[dict[str, Any]]:
    """Return the columns of each row, the same in all; None where a row does not have a key.

    An option of a kind, where there are several kinds, has a column for each of them in which it differs:
    `method.cma_es.step` is another quantity than `method.evostick.step`.

    rows: the experiment of each by dotted keys, and which of these keys differ for it.
    """
    columns: dict[str, None] = {}
    found: list[dict[str, Any]] = [{} for _ in rows]
    for key in dict.fromkeys(key for _, keys in rows for key in keys):
        section, _, option = key.partition(".")
        kinds = {str(values.get(f"{section}.kind")) for values, _ in rows if key in values}
        of_kinds = section in REGISTRIES and len(kinds) > 1 and not _of_all_kinds(section, option)
        for row, (values, keys) in zip(found, rows, strict=True):
            if not of_kinds:
                columns[key] = None
                row[key] = values.get(key)
            elif key in keys:
                column = f"{section}.{values[f'{section}.kind']}.{option}"
                columns[column] = None
                row[column] = values[key]
    return [{column: row.get(column) for column in columns} for row in found]


def _of_all_kinds(section: str, option: str) -> bool:
    return option == "kind" or option in _OF_ALL_KINDS.get(section, ())
