"""VMAS's scenarios, where it is installed: it brings gigabytes, so it is not among what tests need."""

from pathlib import Path

import pytest

from swarmwright import Experiment, adapters, optimize
from swarmwright.testing import check_batch_simulation
from tests.python.records import same_record

pytest.importorskip("vmas", reason="VMAS is not installed")


def test_one_record_in_every_mode(tmp_path: Path) -> None:
    check_batch_simulation(adapters.simulation("vmas:navigation"), {"max_steps": 5})  # type: ignore[arg-type]

    def experiment(mode: str) -> Experiment:
        return Experiment.from_mapping(
            {
                "simulation": "vmas:navigation?n_agents=3",
                "parameters": {"max_steps": 5},
                "controller": {"hidden": []},
                "method": {"population": 4, "generations": 1},
                "mode": mode,
            }
        )

    here = optimize(experiment("auto"), servers="local", out=tmp_path / "here")
    for mode in ("batched", "offloaded"):
        same_record(optimize(experiment(mode), servers=1, out=tmp_path / mode), here)
