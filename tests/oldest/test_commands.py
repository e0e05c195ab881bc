"""The oldest versions of libraries that pyproject.toml allows are enough: what each one is used for."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.conftest import environment
from tests.oldest.requirements import oldest

PYTHON = os.environ.get("SWARMWRIGHT_OLDEST", "")
pytestmark = [
    pytest.mark.skipif(not PYTHON, reason="`make test-oldest` installs old versions"),
    pytest.mark.timeout(120),
]
EXPERIMENT = Path(__file__).parents[2] / "experiments" / "minisim.yaml"


def program(*arguments: object, folder: Path) -> str:
    """Return what a command prints."""
    source = EXPERIMENT.parents[1] / "python"
    result = subprocess.run(
        [PYTHON, "-m", "swarmwright", *map(str, arguments)],
        cwd=folder,
        env=environment({"PYTHONPATH": str(source), "SWARMWRIGHT_PLOT": "1"}),
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("oldest")
    settings = ["--set", "method.generations=3", "--set", "method.population=20"]
    others = ["--mlflow", "sqlite:///mlflow.db", "--tensorboard", "curves", "--metrics", "127.0.0.1:0"]
    program("optimize", EXPERIMENT, *settings, "--servers", 2, "--out", "run", *others, folder=folder)
    assert list((folder / "curves").iterdir())
    assert (folder / "mlflow.db").stat().st_size > 0
    assert (folder / "run" / "fitness.png").stat().st_size > 0
    return folder / "run"


def test_they_are_what_is_installed() -> None:
    code = "import sys; from importlib.metadata import version; print(*map(version, sys.argv[1:]))"
    names, versions = zip(*(requirement.split("==") for requirement in oldest([])), strict=True)
    shown = subprocess.run([PYTHON, "-c", code, *names], capture_output=True, text=True, check=True).stdout
    for found, wanted in zip(shown.split(), versions, strict=True):
        assert f"{found}.0.0".startswith(f"{wanted}.")


@pytest.mark.parametrize("file", ["p.pdf", "p.svg", "p.png"])
def test_plots(file: str, run: Path, tmp_path: Path) -> None:
    program("plot", run, "--out", tmp_path / file, folder=tmp_path)
    assert (tmp_path / file).stat().st_size > 0


@pytest.mark.parametrize("file", ["r.gif", "r.mp4", "r.html", "r.png"])
def test_replays(file: str, run: Path, tmp_path: Path) -> None:
    program("replay", run, "--save", tmp_path / file, folder=tmp_path)
    assert (tmp_path / file).stat().st_size > 0


@pytest.mark.parametrize("target", ["c", "onnx", "fmu"])
def test_exports(target: str, run: Path, tmp_path: Path) -> None:
    shown = program("export", run, "--to", target, "--out", tmp_path / target, "--verify", folder=tmp_path)
    assert "Verified: largest difference 0" in shown


def test_records(run: Path, tmp_path: Path) -> None:
    program("runs", "export", run, tmp_path / "record.parquet", folder=tmp_path)
    assert (tmp_path / "record.parquet").stat().st_size > 0


def test_sweeps(tmp_path: Path) -> None:
    (tmp_path / "sweep.yaml").write_text(
        f"experiment: {EXPERIMENT}\n"
        "grid:\n"
        "  method.kind: [nnga, random_search, cma_es]\n"
        "  method.generations: [2]\n"
        "  method.population: [10]\n"
        "seeds: 8\n"
    )
    assert "Kruskal-Wallis" in program("sweep", "sweep.yaml", "--servers", "in-process", folder=tmp_path)


def test_environments(tmp_path: Path) -> None:
    (tmp_path / "pole.yaml").write_text("simulation: gymnasium:CartPole-v1\nmethod: {generations: 1}\n")
    program("optimize", "pole.yaml", "--servers", "in-process", "--out", "run", folder=tmp_path)


def test_the_conformance_kit(tmp_path: Path) -> None:
    serve = f"{PYTHON} -m swarmwright serve minisim --broker {{broker}} --id {{id}}"
    program("conformance", "server", "--exec", serve, "--rules", "S1", folder=tmp_path)
