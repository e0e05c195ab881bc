"""The record as a mapping of columns, for use with table libraries."""

from collections.abc import ItemsView, Iterator, KeysView, Sequence, ValuesView
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.arrays import read_only_array
from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import did_you_mean
from swarmwright.runs.store.blocks import Record

Column = NDArray[Any]


def import_pyarrow(purpose: str) -> Any:  # noqa: ANN401 - a module
    """Return the module pyarrow. Raises InputError, beginning with `purpose`, when it is not installed."""
    try:
        import pyarrow as pa  # noqa: PLC0415 - optional, and large
    except ImportError:
        raise InputError(f"{purpose} needs PyArrow: pip install 'swarmwright[parquet]'") from None
    return pa


_OTHER_COLUMNS = frozenset(
    {"generation", "candidate", "recorded", "seed", "fitness", "episode", "episodes", "genome"}
)
"""Names of columns in tables of a record or a validation that are not metrics."""


def name_column(metric: str) -> str:
    """Return the column name of a metric: its own, with the prefix metric_ if another column has it."""
    return f"metric_{metric}" if metric in _OTHER_COLUMNS else metric


class RecordTable(Record, dict[str, Column]):  # noqa: PLW1641 - arrays have no hash
    """All evaluations of a run, sorted by generation and candidate, as arrays and as columns by name.

    The attributes are read-only arrays. As a mapping it has an array, (evaluations,), for each column of the
    CSV table that `Run.export` writes: generation, candidate, fitness, episode_0, .., metrics if there are
    any (name_0, ..), then g0, .. (the genome). So `pandas.DataFrame(run.record)` works, and so does polars.
    The columns are created on first access. With PyArrow (`pip install 'swarmwright[parquet]'`) it is also an
    Arrow stream, for DuckDB, polars, pandas, nanoarrow and others.
    """

    def __init__(self, record: Record, metrics: Sequence[str]) -> None:
        Record.__init__(self, **{name: read_only_array(array) for name, array in vars(record).items()})
        object.__setattr__(self, "_metrics", tuple(metrics))

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Names of the metrics, in the order of the last axis of `metrics`."""
        names: tuple[str, ...] = self.__dict__["_metrics"]
        return names

    def _fill_columns(self) -> None:
        if dict.__len__(self):
            return
        episodes = range(self.episodes.shape[1])
        columns = {"generation": self.generation, "candidate": self.candidate, "fitness": self.fitness}
        columns |= {f"episode_{episode}": self.episodes[:, episode] for episode in episodes}
        for index, name in enumerate(map(name_column, self.metric_names)):
            columns |= {f"{name}_{episode}": self.metrics[:, episode, index] for episode in episodes}
        genes = read_only_array(np.ascontiguousarray(self.genomes.T))
        columns |= {f"g{gene}": column for gene, column in enumerate(genes)}
        dict.update(self, columns)

    def __eq__(self, other: object) -> bool:
        """Return whether the other is a table with the same metrics and numbers."""
        if not isinstance(other, RecordTable):
            return NotImplemented
        return Record.__eq__(self, other) is True and self.metric_names == other.metric_names

    def __getitem__(self, name: str) -> Column:
        self._fill_columns()
        return dict.__getitem__(self, name)

    def __missing__(self, name: str) -> Column:
        """Raise KeyError with the available columns; a metric has one for each episode."""
        episodes, genes = self.episodes.shape[1], self.genomes.shape[1]
        names = [
            _format_range(f"{column}_", episodes)
            for column in ("episode", *map(name_column, self.metric_names))
        ]
        keys = [key for key in dict.keys(self) if not (key.startswith("g") and key[1:].isdecimal())]
        available = ", ".join(["generation", "candidate", "fitness", *names, _format_range("g", genes)])
        raise KeyError(f"no column {name!r}{did_you_mean(str(name), keys) or ';'} available: {available}")

    def get(self, name: str, default: Any = None, /) -> Any:  # noqa: ANN401 - as in `dict`
        """Return a column, or the default if it does not exist."""
        self._fill_columns()
        return dict.get(self, name, default)

    def __contains__(self, name: object) -> bool:
        self._fill_columns()
        return dict.__contains__(self, name)

    def __iter__(self) -> Iterator[str]:
        self._fill_columns()
        return dict.__iter__(self)

    def __len__(self) -> int:
        self._fill_columns()
        return dict.__len__(self)

    def keys(self) -> KeysView[str]:  # type: ignore[override] # dict's own view
        """Return the names of the columns."""
        self._fill_columns()
        return dict.keys(self)

    def values(self) -> ValuesView[Column]:  # type: ignore[override] # dict's own view
        """Return the columns."""
        self._fill_columns()
        return dict.values(self)

    def items(self) -> ItemsView[str, Column]:  # type: ignore[override] # dict's own view
        """Return names and columns."""
        self._fill_columns()
        return dict.items(self)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Return the columns as an Arrow stream, in a PyCapsule; failed evaluations have NaN.

        Raises InputError when PyArrow is not installed.
        """
        table = import_pyarrow("the record as an Arrow stream").table(dict(self.items()))
        stream: object = table.__arrow_c_stream__(requested_schema)
        return stream

    def __repr__(self) -> str:
        """Return the numbers of evaluations, episodes and genes."""
        evaluations, genes = self.genomes.shape
        return f"<Record: {evaluations} evaluations, {self.episodes.shape[1]} episodes each, {genes} genes>"


def _format_range(name: str, count: int) -> str:
    """Format the names of columns numbered from 0: `g0 .. g48`."""
    return f"{name}0" if count == 1 else f"{name}0 .. {name}{count - 1}"
