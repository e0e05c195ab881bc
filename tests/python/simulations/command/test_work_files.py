"""Files and folders that are put into the work folder: texts with placeholders, binary files as they are."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, evaluate
from swarmwright.runs.code import collect_code
from swarmwright.simulations.command import work_files

PNG = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR{gain}\xff"
LATIN_1 = "caf\xe9 {gain} {other}".encode("latin-1")
PROGRAM = """
import os, sys
from pathlib import Path
assert Path("map.png").read_bytes() == Path(sys.argv[2], "map.png").read_bytes()
assert Path("world.txt").read_bytes() == b"caf\\xe9 0.5 {other}"
assert Path("meshes/body.bin").read_bytes() == bytes(range(256))
assert Path("meshes/parts/wheel.obj").read_text() == "v 0.5"
assert os.access("meshes/run", os.X_OK) and not os.access("map.png", os.X_OK)
assert not Path("meshes/.hidden").exists()
Path(sys.argv[1]).write_text("fitness\\n1\\n")
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes" / "parts").mkdir(parents=True)
    (tmp_path / "map.png").write_bytes(PNG)
    (tmp_path / "world.txt").write_bytes(LATIN_1)
    (tmp_path / "meshes" / "body.bin").write_bytes(bytes(range(256)))
    (tmp_path / "meshes" / "parts" / "wheel.obj").write_text("v {gain}")
    (tmp_path / "meshes" / ".hidden").touch()
    (tmp_path / "meshes" / "run").touch(0o755)
    (tmp_path / "sim.py").write_text(PROGRAM)
    return tmp_path


def experiment(files: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": {"command": "python3 sim.py {log} {here}", "log": "r.csv", "files": files},
            "controller": {
                "kind": "parameter_set",
                "parameters": {"gain": {"type": "real", "range": [0, 1]}},
            },
        }
    )


@pytest.mark.slow
@pytest.mark.usefixtures("project")
def test_files_of_every_kind_are_copied() -> None:
    one = experiment(["map.png", "world.txt", "meshes"])
    assert evaluate(one, np.full((1, 1), 0.5, np.float32), servers="in-process").tolist() == [1.0]
    (part,) = collect_code(one)
    assert {place for place in part.files if "mesh" in place} == {
        "meshes/body.bin",
        "meshes/parts/wheel.obj",
        "meshes/run",
    }
    assert part.files["map.png"].data == PNG


@pytest.mark.parametrize(
    ("files", "words"),
    [
        (["mapp.png"], "files: .*mapp.png: there is no such file or folder"),
        (["empty"], "files: .*empty: is a folder without files"),
        (["pipe"], "files: .*pipe: is neither a file nor a folder"),
        (
            ["large"],
            r"files: .*large: 65 MiB are more than 64; name it in the command instead, \{here\}/NAME",
        ),
        (["map.png", "meshes/../map.png"], "files: two paths end in the same name"),
        (["."], "files: . needs a name in the work folder"),
        ({"../x": "map.png"}, "files: '../x' is outside the work folder"),
    ],
)
def test_what_cannot_be_copied_is_refused_at_once(files: Any, words: str, project: Path) -> None:
    (project / "empty").mkdir()
    os.mkfifo(project / "pipe")
    with (project / "large").open("wb") as file:
        file.truncate(65 << 20)
    with pytest.raises(InputError, match=words):
        experiment(files)


@pytest.mark.usefixtures("project")
def test_folders_with_too_many_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work_files, "_MOST_FILES", 2)
    with pytest.raises(InputError, match="3 files are more than 2, too many to copy for every episode"):
        experiment(["meshes"])


@pytest.mark.parametrize("simulation", [{"command": "true", "log": "stdout"}, "sim.py:Sim"])
def test_folders_whose_names_are_not_utf8(
    simulation: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9"))
    folder.mkdir()
    (folder / "sim.py").touch()
    monkeypatch.chdir(folder)
    with pytest.raises(
        InputError,
        match=r"simulation.*/caf\\xe9.*: is not valid UTF-8, .*; use another "
        r"name",
    ):
        Experiment.from_mapping({"simulation": simulation})
