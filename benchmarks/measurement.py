"""What was measured: samples of several repetitions, their medians, the table and the file."""

import json
import statistics
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One line of the result.

    value: median of the repetitions, in `unit`. against: the name of the floor it is compared with, if any.
    ratio: median over the repetitions of value / floor, both from the same repetition, so that a machine that
    is busier for a while does not favour one of them.
    """

    name: str
    value: float
    unit: str
    against: str | None = None
    ratio: float | None = None


@dataclass
class Samples:
    """The samples of one quantity, one per repetition. aim: what the ratio should be, such as "<= 1.5".

    row, column: its place in a table of things that are measured alike, beside the list of everything.
    """

    name: str
    unit: str
    against: "Samples | None" = None
    aim: str = ""
    values: list[float] = field(default_factory=list)
    row: str = ""
    column: str = ""

    def add(self, value: float) -> None:
        """Keep the next repetition's value."""
        self.values.append(value)

    def measurement(self) -> Measurement:
        """The medians."""
        value = statistics.median(self.values)
        if self.against is None:
            return Measurement(name=self.name, value=value, unit=self.unit)
        floors = self.against.values
        # A floor that was measured once holds for all repetitions.
        floors = floors if len(floors) == len(self.values) else floors[:1] * len(self.values)
        ratios = [value / floor for value, floor in zip(self.values, floors, strict=True)]
        return Measurement(
            name=self.name,
            value=value,
            unit=self.unit,
            against=self.against.name,
            ratio=statistics.median(ratios),
        )


def write(path: Path, samples: Iterable[Samples]) -> None:
    """Write the JSON list of measurements."""
    path.parent.mkdir(parents=True, exist_ok=True)
    measurements = [asdict(one.measurement()) for one in samples]
    path.write_text(json.dumps(measurements, indent=1) + "\n", encoding="utf-8")


def show(samples: Iterable[Samples], title: str) -> None:
    """Print the measurements: those that have a place in a table of their own there, all others in a list."""
    every = list(samples)
    placed = [one for one in every if one.row]
    if len(placed) < len(every):
        _print(_list([one for one in every if not one.row], title))
    if placed:
        _print(_grid(placed, title))


def _list(samples: Iterable[Samples], title: str) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("measured")
    table.add_column("median", justify="right")
    table.add_column("spread", justify="right")
    table.add_column("unit")
    table.add_column("against")
    table.add_column("ratio", justify="right")
    table.add_column("aim")
    for one in samples:
        line = one.measurement()
        spread = f"{_figure(min(one.values))} .. {_figure(max(one.values))}"
        ratio = "" if line.ratio is None else f"{line.ratio:.2f}"
        table.add_row(line.name, _figure(line.value), spread, line.unit, line.against or "", ratio, one.aim)
    return table


def _grid(samples: Iterable[Samples], title: str) -> Table:
    """Medians, a line for each row."""
    rows: dict[str, dict[str, str]] = {}
    units: dict[str, str] = {}
    for one in samples:
        rows.setdefault(one.row, {})[one.column] = _figure(one.measurement().value)
        units[one.column] = one.unit
    table = Table(title=title, title_justify="left")
    table.add_column("server")
    for column, unit in units.items():
        table.add_column(f"{column}\n{unit}", justify="right")
    for row, figures in rows.items():
        table.add_row(row, *(figures.get(column, "") for column in units))
    return table


def _print(table: Table) -> None:
    console = Console()
    if not console.is_terminal:
        console = Console(width=190)
    console.print(table)


def _figure(value: float) -> str:
    """Three significant digits or whole numbers, whichever is more."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
