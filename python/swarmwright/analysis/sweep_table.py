"""The records of several runs as one table for other programs."""

import csv
import io
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.analysis.groups import (
    collect_mission_names,
    differing_keys,
    flatten_experiment,
    restore_mission_names,
)
from swarmwright.analysis.table import option_columns
from swarmwright.common.errors import InputError
from swarmwright.runs.export import csv_lines, tables, write
from swarmwright.runs.run import Run
from swarmwright.runs.store.table import import_pyarrow

if TYPE_CHECKING:
    import pyarrow as pa


def write_records(runs: Sequence[Run], path: Path) -> None:
    """Write all evaluations of runs as one table, in the order of the runs.

    Columns: run (the name of its folder), seed, the keys in which the experiments differ, then the columns of
    `Run.export`, which are empty for runs without them.

    Raises InputError as `Run.export`, and if two columns would have the same name.
    """
    write(path, lambda: _lines(runs), lambda: _tables(runs))


def _columns(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return the columns that identify each run, with their values."""
    missions = collect_mission_names(runs)
    experiments = [restore_mission_names(flatten_experiment(run), run, missions) for run in runs]
    differing = option_columns(list(zip(experiments, differing_keys(experiments), strict=True)))
    return [
        {"run": run.path.name, "seed": run.experiment.seed, **keys}
        for run, keys in zip(runs, differing, strict=True)
    ]


def _lines(runs: Sequence[Run]) -> Iterator[str]:
    """Yield the lines of a CSV file."""
    leading = _columns(runs)
    headers = [next(csv_lines(run._store)).rstrip("\n").split(",") for run in runs]
    columns = _unite_columns(headers)
    _check(leading[0], columns)
    yield _text([*leading[0], *columns])
    for run, values, header in zip(runs, leading, headers, strict=True):
        first = _text([_cell(value) for value in values.values()])[:-1]
        lines = csv_lines(run._store)
        next(lines)
        places = [columns.index(name) for name in header]
        for line in lines:
            cells = [""] * len(columns)
            for position, cell in zip(places, line.rstrip("\n").split(","), strict=True):
                cells[position] = cell
            yield f"{first},{','.join(cells)}\n"


def _unite_columns(headers: Iterable[Sequence[str]]) -> list[str]:
    """Return all columns of several tables, with numbered ones, such as genes, side by side."""
    names = dict.fromkeys(name for header in headers for name in header)
    parts = {name: re.fullmatch(r"(.*?)(\d*)", name, re.DOTALL) for name in names}
    split = {
        name: (columns[1], int(columns[2] or 0)) for name, columns in parts.items() if columns is not None
    }
    order = {
        prefix: position
        for position, prefix in enumerate(dict.fromkeys(prefix for prefix, _ in split.values()))
    }
    return sorted(names, key=lambda name: (order[split[name][0]], split[name][1]))


def _check(leading: Iterable[str], columns: Iterable[str]) -> None:
    twice = set(leading) & set(columns)
    if twice:
        raise InputError(
            f"the column {min(twice)} would be there twice, of a metric and of the experiment; export each "
            "run alone"
        )


def _text(cells: Iterable[Any]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def _cell(value: Any) -> Any:  # noqa: ANN401 - any value of an experiment
    """Return a value as in a cell: texts and numbers unchanged, others as JSON, None as an empty cell."""
    if value is None or (isinstance(value, str | float | int) and not isinstance(value, bool)):
        return value
    return json.dumps(value, default=str, ensure_ascii=False)


def _tables(runs: Sequence[Run]) -> Iterator["pa.Table"]:
    """Yield the records as Arrow tables with the same columns."""
    pa = import_pyarrow("writing Parquet")
    leading = _columns(runs)
    schemas = [next(tables(run._store)).schema for run in runs]
    fields: dict[str, Any] = {}
    for schema in schemas:
        # Runs may differ in the number of genes or episodes, but a column has one type.
        fields |= {
            column.name: pa.list_(column.type.value_type)
            if pa.types.is_fixed_size_list(column.type)
            else column.type
            for column in schema
        }
    _check(leading[0], fields)
    keys = {name: _array([values[name] for values in leading]) for name in leading[0]}
    schema = pa.schema({**{name: array.type for name, array in keys.items()}, **fields})
    for position, run in enumerate(runs):
        for part in tables(run._store):
            size = len(part)
            columns = {
                name: pa.array([array[position].as_py()] * size, array.type) for name, array in keys.items()
            }
            columns |= {
                name: part[name].cast(kind) if name in part.column_names else pa.nulls(size, kind)
                for name, kind in fields.items()
            }
            yield pa.table(columns, schema=schema)


def _array(values: Sequence[Any]) -> "pa.Array":
    """Return values as an array of one type, which is text if they have several types."""
    pa = import_pyarrow("writing Parquet")
    cells = [_cell(value) for value in values]
    try:
        return pa.array(cells)
    except (pa.ArrowInvalid, pa.ArrowTypeError):
        return pa.array([None if cell is None else str(cell) for cell in cells])
