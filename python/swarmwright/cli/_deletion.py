"""Deletion of runs and sweeps."""

import shlex
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import click

from swarmwright.analysis.sweep_folders import WRITTEN, runs_of
from swarmwright.common.errors import InputError
from swarmwright.common.formatting import format_count
from swarmwright.runs.folders import is_run, remove_run
from swarmwright.runs.run import Run
from swarmwright.runs.store.lock import is_locked


@dataclass(frozen=True)
class Deletion:
    """The content of a folder to delete: a run, or a sweep with its runs."""

    folder: Path
    runs: list[Path]
    is_sweep: bool
    words: str
    """Description for the confirmation."""

    @classmethod
    def from_folder(cls, folder: Path) -> Self:
        """Find the runs to delete with a folder.

        Raises:
            InputError: it holds neither a run nor a sweep.
            UsageError: a process works on a run, or a symbolic link would lead elsewhere.
        """
        _check_no_link(folder)
        recorded = runs_of(folder)
        if recorded is None:
            opened = Run.open(folder)
            _check_free(folder)
            return cls(folder, [folder], False, f"{folder}: {opened.evaluations} evaluations, {opened.state}")
        runs = [run for run in recorded if is_run(run)]
        for run in runs:
            _check_no_link(run)
            _check_free(run)
        evaluations = 0
        for run in runs:
            with suppress(InputError):  # damaged runs are deleted, too
                evaluations += Run.open(run).evaluations
        words = f"{folder}: a sweep of {format_count(len(runs), 'run')}, {evaluations} evaluations"
        return cls(folder, runs, True, words)

    def delete(self) -> Iterator[tuple[Path, list[str]]]:
        """Delete the content; yield each folder with the names of other files, which remain."""
        for run in self.runs:
            if run.exists():  # otherwise it was listed both by itself and by its sweep
                yield run, remove_run(run)
        if not self.is_sweep or not self.folder.exists():
            return
        for name in sorted(WRITTEN):  # sweep.json, which marks a sweep, is the last
            (self.folder / name).unlink(missing_ok=True)
        left = sorted(entry.name for entry in self.folder.iterdir())
        if not left:
            self.folder.rmdir()
        yield self.folder, left


def _check_no_link(folder: Path) -> None:
    if folder.is_symlink():
        raise click.UsageError(
            f"{folder}: is a symbolic link to {folder.readlink()}. Name that folder to delete the run, or "
            f"delete the link alone: rm {shlex.quote(str(folder))}. Nothing was deleted."
        )


def _check_free(run: Path) -> None:
    if is_locked(run):
        raise click.UsageError(f"{run}: a process is writing this run; stop it first. Nothing was deleted.")
