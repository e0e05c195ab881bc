"""Runs that stay in a folder, so that what is done is not repeated."""

from pathlib import Path

from swarmwright import Experiment, Run, optimize, resume


def finished(experiment: Experiment, path: Path) -> Run:
    """Run an experiment, go on with its run, or open it where it is done."""
    run = Run.open(path) if path.exists() else optimize(experiment, out=path)
    return run if run.state == "done" else resume(run)
