"""The lines that tell how far a run is."""

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess


def test_the_number_of_evaluations_is_said_once(
    program: Callable[..., "CompletedProcess[str]"], tmp_path: Path
) -> None:
    (tmp_path / "x.yaml").write_text("simulation: minisim\nmethod: {population: 8}\nvalidate: false\n")
    line = {}
    for limit in ("generations=2", "evaluations=20"):
        done = program("optimize", "x.yaml", "--servers", "local", "--set", f"method.{limit}", "--out", limit)
        assert done.returncode == 0, done.stderr
        line[limit] = done.stdout.splitlines()[0]
    assert line["generations=2"].startswith("1 of 2 generations  best ")
    assert "  8 evaluations (" in line["generations=2"]
    assert line["evaluations=20"].startswith("8 of 20 evaluations  best ")
    assert line["evaluations=20"].count("evaluations") == 1
    assert "/s  " in line["evaluations=20"]
