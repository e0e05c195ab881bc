"""A small run to look at, and comparing what runs left behind."""

from swarmwright import Experiment, Run

EXPERIMENT = Experiment.from_mapping(
    {
        "simulation": "minisim",
        "parameters": {"placement": "random", "maxSteps": 5},
        "method": {"population": 12, "generations": 4},
        "ranking": {"episodes": 2},
        "servers": "local",
    }
)


def same_record(run: Run, expected: Run) -> None:
    """Two runs have the same record, figures and best controller, byte for byte."""
    assert run.digest == expected.digest
    assert run.history == expected.history
    assert (run.path / "best.json").read_bytes() == (expected.path / "best.json").read_bytes()
