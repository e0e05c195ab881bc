"""Every method in a whole run, from an experiment to its record."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from swarmwright import Experiment, optimize
from swarmwright.methods import METHODS


@pytest.mark.parametrize("kind", sorted(METHODS.built_in))
def test_a_run_with_every_method(kind: str, tmp_path: Path) -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "servers": "local", "method": {"kind": kind, "generations": 4}, "seed": 3}
    )
    runs = [optimize(experiment, out=tmp_path / name) for name in ("one", "other")]
    one, other = (run.record for run in runs)
    assert len(one.fitness) == runs[0].evaluations > 4
    assert np.isfinite(one.fitness).all()
    assert runs[0].best.fitness == one.fitness.max()
    assert one.genomes.tobytes() == other.genomes.tobytes()
    assert one.fitness.tobytes() == other.fitness.tobytes()
    used = {"cma_es": {"cma"}, "sep_cma_es": {"cma"}}.get(kind, set())
    versions = runs[0].sessions[0].versions
    assert versions.keys() & {"cma"} == used
    assert all(versions.values())
    last = runs[0].history[-1]
    assert last.evaluations == runs[0].evaluations
    assert last.best_so_far == one.fitness.max()


def test_libraries_are_imported_when_they_are_used() -> None:
    code = """if True:
        import sys
        from swarmwright import Experiment
        Experiment.json_schema()
        for kind in ("cma_es", "sep_cma_es"):
            values = {"simulation": "minisim", "method": {"kind": kind}}
            experiment = Experiment.from_mapping(values)
            experiment.new_method(experiment.representation())
        print(sorted({"cma", "scipy", "matplotlib"} & set(sys.modules)))
    """
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"
