"""What was probably meant by the name of a simulation."""

import re
from pathlib import Path

import pytest

from swarmwright import Experiment, InputError, optimize, simulate
from swarmwright.common.simulation_names import _SIMULATOR_FILES, SIMULATORS
from swarmwright.interop.models._files import load
from swarmwright.simulations.near_names import describe_unknown_simulation, suggest_title

SOURCE = """
from swarmwright import Simulation
raise RuntimeError("is not imported")

class Pursuit(Simulation):
    title = "hunt"
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "hunt",
            "unknown simulation 'hunt'; did you mean 'chase.py:Pursuit'? available: arena, emergency_exit",
        ),
        ("Pursuit", "did you mean 'chase.py:Pursuit'?"),
        ("gym:Acrobot-v1", "did you mean 'gymnasium:Acrobot-v1'?"),
        ("gymnasiun:Acrobot-v1", "did you mean 'gymnasium:Acrobot-v1'?"),
        ("Acrobot-v1", "did you mean 'gymnasium:Acrobot-v1'?"),
        ("minisin", "did you mean 'minisim'?"),
        ("zzz", "unknown simulation 'zzz'; available: arena, emergency_exit, minisim"),
    ],
)
def test_the_whole_name_is_told(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "chase.py").write_text(SOURCE)
    (tmp_path / "damaged.py").write_text("class")
    assert words in describe_unknown_simulation(name, tmp_path)
    (tmp_path / "one.yaml").write_text(f"simulation: {name}\n")
    with pytest.raises(InputError) as raised:
        optimize(Experiment.load(tmp_path / "one.yaml"), servers="local", out=tmp_path / "run")
    assert words in str(raised.value)


def test_a_file_that_is_misspelt(tmp_path: Path) -> None:
    (tmp_path / "chase.py").write_text(SOURCE)
    with pytest.raises(InputError, match=r"chas.py: there is no such file; did you mean 'chase.py'\?$"):
        Experiment.from_mapping({"simulation": f"{tmp_path / 'chas.py'}:Pursuit"})


@pytest.mark.parametrize(("source", "name"), [(SOURCE, "chase.py:Pursuit"), ("", "chase.py:CLASS")])
def test_a_class_in_the_place_of_an_experiment(source: str, name: str, tmp_path: Path) -> None:
    (tmp_path / "chase.py").write_text(source)
    with pytest.raises(
        InputError, match=rf"a Python program is not an experiment; .* the line 'simulation: {name}'$"
    ):
        Experiment.load(tmp_path / "chase.py")


def test_every_simulator_that_has_servers_is_known(root: Path) -> None:
    sources = [
        source
        for folder in ("wrappers/argos", "wrappers/stage", "wrappers/gazebo/src")
        for source in (root / folder).rglob("*.?pp")
        if "build" not in source.parts
    ]
    sources += (root / "python" / "swarmwright" / "simulations").rglob("*.py")
    found = {
        title
        for source in sources
        for title in re.findall(r'"((?:arena-[a-z0-9]+)|argos|stage)"', source.read_text(encoding="utf-8"))
    }
    assert found == set(SIMULATORS)


@pytest.mark.parametrize("ending", _SIMULATOR_FILES)
def test_files_of_other_simulators_name_the_page_that_attaches_them(
    root: Path, tmp_path: Path, ending: str
) -> None:
    file = tmp_path / f"my{ending}"
    file.write_text('<?xml version="1.0"?>\n<a:b c="d: e"/>\n')
    (tmp_path / "one.yaml").write_text(f"simulation: {file.name}\n")
    for attempt in (
        lambda: optimize(Experiment.load(tmp_path / "one.yaml"), servers="local", out=tmp_path / "run"),
        lambda: Experiment.load(file),
        lambda: load(file),
    ):
        with pytest.raises(InputError, match=r"is a file of .*; docs/how-to/\S+\.md") as raised:
            attempt()
        for page in re.findall(r"docs/\S+\.md", str(raised.value)):
            assert (root / page).is_file()


@pytest.mark.parametrize(("title", "page"), SIMULATORS.items())
def test_their_pages_tell_of_them(root: Path, title: str, page: str) -> None:
    assert title in (root / page).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("arena-gazbo", "arena-gazebo"),
        ("arena_gazebo", "arena-gazebo"),
        ("gazebo", "arena-gazebo"),
        ("mujoco", "arena-mujoco"),
        ("arina", "arena"),
    ],
)
def test_titles_of_simulators_that_are_nearly_right(written: str, meant: str) -> None:
    assert suggest_title(written) == f"; did you mean '{meant}'?"
    assert describe_unknown_simulation(written).startswith(
        f"unknown simulation {written!r}; did you mean '{meant}'? available: arena,"
    )


@pytest.mark.parametrize("title", ["arena", "arena-gazebo", "stage", "file.py:Class"])
def test_what_is_known_is_not_corrected(title: str) -> None:
    assert suggest_title(title) == ""


def test_where_one_is_found_is_told() -> None:
    experiment = Experiment.from_mapping({"simulation": "arena-gazebo"})
    with pytest.raises(InputError) as caught:
        simulate(experiment, servers="local")
    assert str(caught.value) == (
        "simulation: 'arena-gazebo' is not built in: servers of another simulator offer it, see "
        "docs/how-to/simulators.md; set `broker` to a broker with a server that offers it"
    )
    with pytest.raises(InputError, match="simulations such as arena-argos, "):
        simulate(Experiment.from_mapping({"simulation": "gazebo"}), servers="local")
