from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, optimize
from swarmwright.servers.evaluation.launched.starting import pack_code
from swarmwright.servers.launchers import Code
from swarmwright.servers.launchers._base import Specification
from swarmwright.servers.launchers.process import ProcessOptions


@pytest.mark.parametrize("prefix", ["", "lab1"])
def test_the_prefix_is_that_of_the_run_whatever_the_environment_there_has(prefix: str) -> None:
    arguments = Specification("minisim", "mqtt://lab:1883", prefix=prefix).arguments(7)
    assert arguments[arguments.index("--prefix") + 1] == prefix


def test_the_same_files_give_the_same_bytes_in_any_order() -> None:
    one = Code.from_files({"a.py": b"1", "b/c.txt": b"2"}, {"a.py"})
    other = Code.from_files({"b/c.txt": b"2", "a.py": b"1"}, {"a.py"})
    assert one == other
    assert Code.from_files({"a.py": b"1", "b/c.txt": b"2"}).digest != one.digest
    assert Code.from_files({"a.py": b"12", "b/c.txt": b""}).digest != one.digest


def test_files_are_unpacked(tmp_path: Path) -> None:
    Code.from_files({"a.py": b"1", "b/c.txt": b"2"}, {"a.py"}).unpack(tmp_path / "new")
    assert (tmp_path / "new" / "a.py").stat().st_mode & 0o777 == 0o755
    assert (tmp_path / "new" / "b" / "c.txt").read_bytes() == b"2"


def test_imported_modules_and_named_files_travel(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "hall.json").write_text("{}")
    (tmp_path / "walls.py").write_text("WALLS = 3\n")
    (tmp_path / "unused.py").write_text("")
    (tmp_path / "gather.py").write_text("import walls\nclass Gather: pass\n")
    simulation = f"{tmp_path}/gather.py:Gather"
    name, _, code = pack_code(simulation, [], ProcessOptions(files=["maps/*.json"]))
    assert name == "gather.py:Gather"
    assert code is not None
    code.unpack(tmp_path / "new")
    found = {str(path.relative_to(tmp_path / "new")) for path in (tmp_path / "new").rglob("*.*")}
    assert found == {"gather.py", "walls.py", "maps/hall.json"}
    assert pack_code(simulation, [], ProcessOptions(code="/opt/gather")) == ("gather.py:Gather", [], None)
    for pattern, message in (("map/*.json", "there is no file"), ("../x", "must lie in")):
        with pytest.raises(InputError, match=f"servers: files: .*{message}"):
            pack_code(simulation, [], ProcessOptions(files=[pattern]))


def test_built_in_simulations_have_no_code() -> None:
    assert pack_code("minisim", [], ProcessOptions()) == ("minisim", [], None)
    with pytest.raises(InputError, match="servers: code: has no effect, as the simulation is installed"):
        pack_code("minisim", [], ProcessOptions(code="/opt"))


@pytest.mark.parametrize(("options", "key"), [({"code": "/opt"}, "code"), ({"files": ["a.json"]}, "files")])
def test_servers_on_this_machine_refuse_what_has_no_effect(
    tmp_path: Path, options: dict[str, Any], key: str
) -> None:
    made = Experiment.from_mapping(
        {"simulation": "minisim", "servers": {"launcher": "process", **options}, "validate": False}
    )
    with pytest.raises(InputError, match=f"servers: {key}: .*; leave it out"):
        optimize(made, out=tmp_path / "run", progress=False)


def test_each_module_travels_with_what_it_imports(tmp_path: Path) -> None:
    for folder, speed in (("one", "1"), ("other", "2")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "parts.py").write_text(
            "import speeds\nclass Spiral: pass\nclass Elapsed: pass\n"
        )
        (tmp_path / folder / "speeds.py").write_text(f"SPEED = {speed}\n")
    names = [f"{tmp_path}/one/parts.py:{name}" for name in ("Spiral", "Elapsed")]
    name, modules, code = pack_code(
        "arena", [*names, f"{tmp_path}/other/parts.py:Spiral", "installed"], ProcessOptions()
    )
    assert (name, modules[-1]) == ("arena", "installed")
    assert code is not None
    code.unpack(tmp_path / "new")
    places = [tmp_path / "new" / one.rpartition(":")[0] for one in modules[:-1]]
    assert places[0] == places[1] != places[2]
    assert [(place.parent / "speeds.py").read_text() for place in places] == [
        "SPEED = 1\n",
        "SPEED = 1\n",
        "SPEED = 2\n",
    ]
    assert [one.rpartition(":")[2] for one in modules[:-1]] == ["Spiral", "Elapsed", "Spiral"]
    at = pack_code("arena", names, ProcessOptions(code="/opt"))
    assert at == ("arena", ["parts.py:Spiral", "parts.py:Elapsed"], None)
