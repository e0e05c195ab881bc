"""The files of a module and of what it imports are found without running any of it."""

import sys
from pathlib import Path

import pytest

from swarmwright.simulations.user_code.imports import Walk
from swarmwright.simulations.user_code.parts import Part, distributions, read_simulation


def write(folder: Path, **files: str) -> None:
    for name, text in files.items():
        path = folder / f"{name.replace('__in__', '/')}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def test_neighbours_are_followed_wherever_they_are_imported(tmp_path: Path) -> None:
    write(
        tmp_path,
        main="import walked_one\nraise SystemExit('this is never run')\n",
        walked_one="def later():\n    from walked_pack.inner import walked_two\n    import json, numpy\n",
        walked_three="broken = = 1",
        walked_pack__in____init__="",
        walked_pack__in__inner__in____init__="from .. import other\nfrom .missing import gone\n",
        walked_pack__in__inner__in__walked_two="import walked_pack.plain as p\nfrom walked_three import *\n",
        walked_pack__in__other="",
        walked_pack__in__plain="from . import inner",
        unused="",
    )
    walk = Walk.from_file(tmp_path / "main.py")
    inner = ("__init__.py", "walked_two.py")
    assert sorted(walk.files) == sorted(
        [
            "main.py",
            "walked_one.py",
            "walked_three.py",
            "walked_pack/__init__.py",
            "walked_pack/other.py",
            "walked_pack/plain.py",
            *(f"walked_pack/inner/{name}" for name in inner),
        ]
    )
    assert walk.files["walked_pack/plain.py"] == tmp_path / "walked_pack" / "plain.py"
    assert walk.packages == {"numpy"}
    assert "walked_one" not in sys.modules


def test_installed_packages_are_named_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = tmp_path / "somewhere"
    write(site, walked_library="import walked_inner", walked_inner="")
    (site / "walked_library-1.5.dist-info").mkdir()
    information = site / "walked_library-1.5.dist-info" / "METADATA"
    information.write_text("Metadata-Version: 2.1\nName: walked_library\nVersion: 1.5\n")
    write(tmp_path, main="import walked_library")
    monkeypatch.syspath_prepend(str(site))
    part = Part.from_file("simulation", "main.py:Main", tmp_path / "main.py")
    assert list(part.files) == ["main.py"]
    assert distributions([part]) == ("walked_library",)
    # A simulation or a plug-in that is itself installed is source of the run.
    own = Part.from_module("method", "kind", "walked_library")
    assert own is not None
    assert (list(own.files), own.main) == (["walked_library.py"], "walked_library.py")
    assert Part.from_module("method", "kind", "walked_missing") is None


def test_what_has_no_source_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    write(tmp_path, walked_env="")
    assert read_simulation("__main__:Gather") is None
    assert read_simulation("swarmwright.simulations.mujoco:Rovers") is None
    assert read_simulation("gymnasium:CartPole-v1") is None
    adapted = read_simulation("gymnasium:walked_env:Own-v1")
    assert adapted is not None
    assert list(adapted.files) == ["walked_env.py"]
