"""Commands of `swarmwright runs` for the folders of sweeps."""

from collections.abc import Sequence
from pathlib import Path

from swarmwright.cli._output import Output, complain
from swarmwright.common.formatting import counted


def with_sweeps(folders: list[Path]) -> list[tuple[Path, bool]]:
    """Return run folders, with those of sweeps instead of their folder; True for one that a sweep asks for.

    Raises InputError where the record of a sweep cannot be read.
    """
    from swarmwright.analysis.sweep_folders import runs_of
    from swarmwright.runs.store import FILE

    found: dict[Path, bool] = {}
    for folder in folders:
        asked = runs_of(folder)
        found |= dict.fromkeys([folder] if asked is None else asked, asked is not None)
        if asked is not None:  # and what other sweeps have put there
            found = dict.fromkeys((store.parent for store in sorted(folder.glob(f"*/{FILE}"))), False) | found
    return list(found.items())


def export_records(output: Output, folder: Path, file: Path) -> int:
    """Write the records of the runs of a sweep as one table; return the exit status, 1 where some lack.

    Unlike comparisons, it has what runs that have not finished have recorded.
    """
    from swarmwright import InputError
    from swarmwright.analysis.sweep_table import write_records
    from swarmwright.cli._comparison import INCOMPLETE, readable_runs, run_folders

    folders, missing = run_folders([folder])
    opened, unreadable = readable_runs(folders)
    runs = [run for run in opened if run.history]
    empty = [run for run in opened if not run.history]
    for run in empty:
        complain(f"left out: {run.path}: holds no finished generation to write")
    if not runs:
        raise InputError(f"{folder}: none of its runs holds a finished generation to write")
    write_records(runs, file)
    output.text(f"The records of {counted(len(runs), 'run')} are in {file}")
    output.json({"run": str(folder), "file": str(file), "runs": [str(run.path) for run in runs]})
    return INCOMPLETE if missing or unreadable or empty else 0


def show_differences(output: Output, ones: Sequence[Path], others: Sequence[Path]) -> int:
    """Compare the records of runs of the same name; return the exit status, 1 unless all are the same.

    Args:
        output: for a line of each run that differs or is missing, with --json of each.
        ones: the runs of a sweep.
        others: those of the other one.
    """
    there = {run.name: run for run in others}
    same = 0
    for one in ones:
        difference = _difference(one, there.pop(one.name, None))
        same += difference is None
        output.json({"run": one.name, "same": difference is None, "difference": difference})
        if difference is not None:
            output.item(f"{one.name}: {difference}")
    for name in there:
        output.json({"run": name, "same": False, "difference": "only the second sweep has it"})
        output.item(f"{name}: only the second sweep has it")
    whole = len(ones) + len(there)
    output.text(f"The records of {same} of {counted(whole, 'run')} are the same, byte for byte.")
    return 0 if same == whole else 1


def _difference(one: Path, other: Path | None) -> str | None:
    """Return how two runs differ, in words; None where their records are the same."""
    from swarmwright import Run
    from swarmwright.runs.differences import first_difference

    if other is None:
        return "only the first sweep has it"
    missing = [str(run) for run in (one, other) if not run.exists()]
    if missing:
        return f"{' and '.join(missing)}: missing"
    return first_difference(Run.open(one), Run.open(other))
