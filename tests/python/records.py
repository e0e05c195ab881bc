"""Comparing what runs left behind."""

from swarmwright import Run


def same_record(run: Run, expected: Run) -> None:
    """Two runs have the same record, figures and best controller, byte for byte."""
    assert run.digest == expected.digest
    assert run.history == expected.history
    assert (run.path / "best.json").read_bytes() == (expected.path / "best.json").read_bytes()
