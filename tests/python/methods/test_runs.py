"""Every method in a whole run, from an experiment to its record."""

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from swarmwright import Experiment, InputError, optimize
from swarmwright.methods import METHODS
from tests.python.methods.needed import method_of


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(METHODS.built_in))
def test_a_run_with_every_method(kind: str, tmp_path: Path) -> None:
    experiment = Experiment.from_mapping(
        {
            "simulation": "minisim",
            "servers": "local",
            "controller": {"kind": "neat" if kind == "neat" else "layered"},
            "method": method_of(kind, generations=4),
            "seed": 3,
        }
    )
    runs = [optimize(experiment, out=tmp_path / name) for name in ("one", "other")]
    one, other = (run.record for run in runs)
    assert len(one.fitness) == runs[0].evaluations > 4
    assert np.isfinite(one.fitness).all()
    assert runs[0].best.fitness == one.fitness.max()
    assert one.genomes.tobytes() == other.genomes.tobytes()
    assert one.fitness.tobytes() == other.fitness.tobytes()
    versions = runs[0].sessions[0].versions
    assert all(versions.values())
    libraries = METHODS.get(kind).libraries
    assert libraries == (("optuna",) if kind == "tpe" else ()), "the engine does the rest"
    assert set(libraries) <= set(versions)
    last = runs[0].history[-1]
    assert last.evaluations == runs[0].evaluations
    assert last.best_so_far == one.fitness.max()


@pytest.mark.slow
def test_the_record_names_the_libraries_of_a_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(METHODS.get("random_search"), "libraries", ("pymoo",))
    values = {"simulation": "minisim", "method": {"kind": "random_search", "generations": 1}}
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "run")
    assert run.sessions[0].versions["pymoo"] == version("pymoo")


def test_a_method_whose_library_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(METHODS.get("random_search"), "libraries", ("numpy", "no_such_one"))
    with pytest.raises(InputError, match="random_search needs no_such_one; run pip install no_such"):
        Experiment.from_mapping({"simulation": "minisim", "method": {"kind": "random_search"}})


@pytest.mark.slow
def test_methods_need_no_other_libraries() -> None:
    code = """if True:
        import sys
        from swarmwright import Experiment
        Experiment.json_schema()
        for kind in ("cma_es", "sep_cma_es"):
            values = {"simulation": "minisim", "method": {"kind": kind}}
            experiment = Experiment.from_mapping(values)
            method = experiment.new_method(experiment.representation())
            method.tell(method.ask()[:, 0].astype("float64"))
        print(sorted({"cma", "scipy", "matplotlib"} & set(sys.modules)))
    """
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"
