"""What stays in a folder, so that what is done is not repeated: runs, and files of what was measured."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from swarmwright import Experiment, Run, optimize, resume

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def finished(experiment: Experiment, path: Path) -> Run:
    """Run an experiment, go on with its run, or open it where it is done."""
    run = Run.open(path) if path.exists() else optimize(experiment, out=path)
    return run if run.state == "done" else resume(run)


def write(measured: "Iterable[DataclassInstance]", path: Path, about: str) -> None:
    """Write what was measured as JSON, one line for each, with what it is about."""
    lines = ",\n".join(f"  {json.dumps(asdict(one))}" for one in measured)
    whole = path.with_suffix(".part")
    whole.write_text(f'{{"about": {json.dumps(about)}, "measured": [\n{lines}\n]}}\n', encoding="utf-8")
    whole.replace(path)


def read(path: Path, kind: type[T]) -> Iterator[T]:
    """Yield what a file holds."""
    for one in json.loads(path.read_text(encoding="utf-8"))["measured"]:
        yield kind(
            **{name: tuple(value) if isinstance(value, list) else value for name, value in one.items()}
        )
