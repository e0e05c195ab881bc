"""Export the record as a table for other programs."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright import _engine
from swarmwright.common.errors import InputError
from swarmwright.runs.store import Record, StoreReader
from swarmwright.runs.store.table import import_pyarrow, name_column

if TYPE_CHECKING:
    import pyarrow as pa

FORMATS = (".csv", ".parquet")
"""Suffixes of supported files."""


def write_table(store: StoreReader, path: Path) -> None:
    """Write a store's record to a table file. Raises InputError as `write`."""
    write(path, lambda: csv_lines(store), lambda: tables(store))


def write(path: Path, lines: Callable[[], Iterable[str]], arrow: Callable[[], Iterable["pa.Table"]]) -> None:
    """Write a table to a file.

    Args:
        path: path of the file, whose suffix is one of `FORMATS`.
        lines: returns the lines for CSV.
        arrow: returns the parts for Parquet, with the same columns.

    Raises InputError when the file cannot be written, or a store is damaged; then no file is left.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(
            f"{path}: unknown table format; choose a file name that ends with {' or '.join(FORMATS)}"
        )
    try:
        if suffix == ".parquet":
            _write_parquet(arrow, path)
        else:
            with path.open("w", encoding="utf-8", newline="") as file:
                file.writelines(lines())
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
    except InputError:
        if path.is_file():  # not a pipe
            path.unlink()  # a partial record would look complete
        raise


def csv_lines(store: StoreReader) -> Iterator[str]:
    """Yield a header and a line per evaluation, with the shortest decimals that preserve each number."""
    metrics = store.metrics
    empty = True
    for part in store.rows():
        if empty:
            yield _header(part, metrics)
            empty = False
        genes = _engine.decimals(part.genomes)
        rows = zip(
            part.generation.tolist(),
            part.candidate.tolist(),
            part.fitness.tolist(),
            part.episodes.tolist(),
            part.metrics.transpose(0, 2, 1).reshape(len(genes), -1).tolist(),
            genes,
            strict=True,
        )
        for generation, candidate, fitness, episodes, values, text in rows:
            numbers = ",".join(map(repr, (generation, candidate, fitness, *episodes, *values)))
            yield f"{numbers},{text}\n"
    if empty:
        yield "generation,candidate,fitness\n"


def _header(part: Record, metrics: list[str]) -> str:
    episodes = range(part.episodes.shape[1])
    columns = ["generation", "candidate", "fitness", *(f"episode_{episode}" for episode in episodes)]
    columns += [f"{name_column(metric)}_{episode}" for metric in metrics for episode in episodes]
    columns += [f"g{gene}" for gene in range(part.genomes.shape[1])]
    return ",".join(columns) + "\n"


def tables(store: StoreReader) -> Iterator["pa.Table"]:
    """Yield the record in parts, as Arrow tables."""
    for part in store.rows():
        yield _arrow(part, store.metrics)


def _write_parquet(arrow: Callable[[], Iterable["pa.Table"]], path: Path) -> None:
    pa = import_pyarrow(f"{path}: writing Parquet")
    from pyarrow import parquet

    writer: Any = None
    try:
        for table in arrow():
            if writer is None:
                writer = parquet.ParquetWriter(path, table.schema, compression="zstd")
            writer.write_table(table)
        if writer is None:
            raise InputError(f"{path}: the run has no finished generation to export")
    except pa.ArrowException as error:
        raise InputError(f"{path}: cannot be written: {error}") from error
    finally:
        if writer is not None:
            writer.close()


def _arrow(part: Record, metrics: list[str]) -> "pa.Table":
    import pyarrow as pa

    def lists(values: Any) -> "pa.Array":  # noqa: ANN401 - an array of numbers
        return pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), values.shape[1])

    columns: dict[str, Any] = {
        "generation": part.generation,
        "candidate": part.candidate,
        # A failed evaluation has an empty fitness, not NaN.
        "fitness": pa.array(part.fitness, from_pandas=True),
        "episodes": lists(part.episodes),
        **{name_column(name): lists(part.metrics[:, :, index].copy()) for index, name in enumerate(metrics)},
        "genome": lists(part.genomes),
    }
    return pa.table(columns)
