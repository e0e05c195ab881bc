"""Systems of FMUs: steps of both algorithms, units, evolution, what fails, mistakes."""

import zipfile
from pathlib import Path
from typing import Any

import pytest
from fmpy.ssp.ssd import read_ssd
from pythonfmu.builder import FmuBuilder

from swarmwright import Experiment, InputError, Run, RunError, evaluate, optimize
from swarmwright.cli import run
from swarmwright.common.random_numbers import Stream
from swarmwright.simulations.fmu.program import Coupled
from swarmwright.simulations.fmu.ssp import Algorithm, describe, read_system
from tests.data.fmu.battery import Battery
from tests.data.fmu.radio import Radio
from tests.data.fmu.vehicle import Vehicle

SOURCES = Path(__file__).parents[3] / "data" / "fmu"
CONNECTIONS = ("battery.force:world.thrust", "world.goal_x:radio.sent")
UNITS = (
    '<UnitDefinitions><Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit>'
    '<Unit name="kN"><BaseUnit kg="1" m="1" s="-2" factor="1000"/></Unit>'
    '<Unit name="m"><BaseUnit m="1"/></Unit></UnitDefinitions>'
)


def with_unit(file: Path, variable: str, unit: str) -> None:
    """Give a variable of an FMU a unit."""
    with zipfile.ZipFile(file) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    text = contents["modelDescription.xml"].decode()
    before, name, after = text.partition(f'name="{variable}"')
    assert name
    text = before.replace("<ModelVariables>", f"{UNITS}<ModelVariables>") + name
    text += after.replace("<Real", f'<Real unit="{unit}"', 1)
    contents["modelDescription.xml"] = text.encode()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in contents.items():
            archive.writestr(name, content)


@pytest.fixture(scope="module")
def parts(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with battery.fmu (kN), world.fmu (N), radio.fmu, and the system of them."""
    folder = tmp_path_factory.mktemp("parts")
    (folder / "world.fmu").write_bytes((fmus / "Vehicle.fmu").read_bytes())
    for name in ("battery", "radio"):
        FmuBuilder.build_FMU(SOURCES / f"{name}.py", dest=folder)
        (folder / f"{name.capitalize()}.fmu").rename(folder / f"{name}.fmu")
    with_unit(folder / "battery.fmu", "force", "kN")
    with_unit(folder / "world.fmu", "thrust", "N")
    assert couple(folder, *CONNECTIONS) == 0
    return folder


def couple(folder: Path, *connections: str, output: str = "system.ssp") -> int:
    files = [str(folder / f"{name}.fmu") for name in ("battery", "world", "radio")]
    words = [word for text in connections for word in ("--connect", text)]
    return run(["couple", *files, *words, "--output", str(folder / output)])


def experiment(parts: Path, **changes: Any) -> Experiment:
    simulation = {
        "fmu": str(parts / "system.ssp"),
        "sensors": ["radio.received", "world.goal_y"],
        "actuators": ["world.steer", "battery.thrust"],
        "seed": "world.seed",
        **changes,
    }
    return Experiment.from_mapping(
        {
            "simulation": simulation,
            "parameters": {"world.mass": 1.5, "battery.capacity": 1.2},
            "fitness": "-world_distance - 0.1 * battery_used",
            "method": {"kind": "nnga", "population": 6, "generations": 3},
            "ranking": {"episodes": 2},
        }
    )


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss_seidel"])
def test_steps_are_those_of_the_parts(parts: Path, algorithm: Algorithm, tmp_path: Path) -> None:
    """The same models, called one after another by this test."""
    file = parts / "system.ssp"
    read_ssd(str(file))  # FMPy's check against the standard's schema
    system, variables = Coupled(str(file), read_system(file), tmp_path, algorithm), describe(file).variables
    world, battery, radio = (kind(instance_name="x", resources="") for kind in (Vehicle, Battery, Radio))
    battery.capacity = 0.6
    for part in (world, battery, radio):
        part.exit_initialization_mode()
    system.begin({"battery.capacity": 0.6}, 0.0, 2.0)
    for step in range(12):
        actuators = [0.3 - 0.05 * step, 0.9]
        system.put([variables["world.steer"], variables["battery.thrust"]], actuators)
        world.steer, battery.thrust = actuators
        if algorithm == "jacobi":
            world.thrust, radio.sent = 1000.0 * battery.force, world.goal_x
        battery.do_step(step * 0.1, 0.1)
        if algorithm == "gauss_seidel":
            world.thrust = 1000.0 * battery.force
        world.do_step(step * 0.1, 0.1)
        if algorithm == "gauss_seidel":
            radio.sent = world.goal_x
        radio.do_step(step * 0.1, 0.1)
        system.step(step * 0.1, 0.1)
        names = ["world.goal_x", "world.distance", "radio.received", "battery.force", "battery.used"]
        expected = [world.goal_x, world.distance, radio.received, battery.force, battery.used]
        assert system.numbers([variables[name] for name in names]) == expected
    assert battery.force == 0.0  # it is empty
    system.end()


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_a_controller_is_evolved_on_three_parts(parts: Path, tmp_path: Path) -> None:
    """The run is repeatable, and does not need the original files."""
    made = experiment(parts)
    found = optimize(made, out=tmp_path / "run")
    assert found.record.fitness.max() == found.best.fitness
    genomes = made.representation().initial(Stream(3, "ssp"))[None]
    runs = [evaluate(one, genomes) for one in (made, Run.open(tmp_path / "run").experiment)]
    assert runs[0] == runs[1]
    others = evaluate(experiment(parts, algorithm="jacobi"), genomes)
    assert others != runs[0]


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_the_component_that_hangs_is_named(parts: Path, tmp_path: Path) -> None:
    made = experiment(parts, timeout=3.0, start={"world.trouble": "hang"}).replace(
        method={"kind": "random_search", "population": 1, "generations": 1}, ranking={"episodes": 1}
    )
    with pytest.raises(RunError, match=r"waiting for the component world, which makes its step from 0\.5 s"):
        optimize(made, out=tmp_path / "run")


@pytest.mark.parametrize(
    ("connections", "expected"),
    [
        (["battery.forc:world.thrust"], "did you mean 'force'?"),
        (["batery.force:world.thrust"], "there is no component 'batery'; did you mean 'battery'?"),
        (["world.thrust:battery.force"], "world.thrust has the causality input, expected output"),
        (["battery.force:world.thrust", "battery.used:world.thrust"], "is already connected"),
        (["battery.force"], "expected COMPONENT.OUTPUT:COMPONENT.INPUT"),
    ],
)
def test_mistakes_in_connections(
    parts: Path, connections: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert couple(parts, *connections, output="wrong.ssp") == 2
    assert expected in capsys.readouterr().err
    assert not (parts / "wrong.ssp").exists()


def test_units_of_different_quantities(
    parts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("battery", "world", "radio"):
        (tmp_path / f"{name}.fmu").write_bytes((parts / f"{name}.fmu").read_bytes())
    with_unit(tmp_path / "radio.fmu", "sent", "m")
    assert couple(tmp_path, "battery.force:radio.sent") == 2
    assert (
        "battery.force [kN] and radio.sent [m]: these units are of different quantities"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("resources/radio.fmu", "resources/lost.fmu", "resources/lost.fmu: cannot be extracted"),
        ('endConnector="sent"', 'endConnector="send"', "has no variable 'send'; did you mean 'sent'?"),
        ("<ssd:Connections>", "<ssd:Connexions>", "is not an SSP"),
    ],
)
def test_files_that_are_wrong(parts: Path, tmp_path: Path, old: str, new: str, expected: str) -> None:
    with zipfile.ZipFile(parts / "system.ssp") as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    text = contents["SystemStructure.ssd"].decode()
    assert old in text
    contents["SystemStructure.ssd"] = text.replace(old, new).encode()
    with zipfile.ZipFile(tmp_path / "system.ssp", "w") as archive:
        for name, content in contents.items():
            archive.writestr(name, content)
    with pytest.raises(InputError, match="(?s)fmu: .*" + expected.replace("?", r"\?")):
        experiment(tmp_path)
