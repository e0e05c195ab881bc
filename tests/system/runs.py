"""What a run left behind."""

import csv
import json
from pathlib import Path
from typing import Any

RECORD = ("record.csv", "generations.csv", "best.json")


def record(folder: Path) -> dict[str, bytes]:
    """The run record, which depends on the experiment and its seed alone."""
    return {name: (folder / name).read_bytes() for name in RECORD}


def evaluations(folder: Path) -> list[tuple[float, list[float]]]:
    """Fitness and genome of every evaluation."""
    with (folder / "record.csv").open(newline="") as file:
        return [
            (float(row["fitness"]), [float(row[key]) for key in row if key[0] == "g" and key[1:].isdigit()])
            for row in csv.DictReader(file)
        ]


def journal(folder: Path, event: str | None = None) -> list[dict[str, Any]]:
    """The journal's entries, of one kind if that is named."""
    entries = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    return [entry for entry in entries if event in {None, entry["event"]}]
