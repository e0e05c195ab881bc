"""Values of booleans, integers, enumerations and text: actuators, starts, seeds, messages of FMUs."""

import contextlib
import io
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import pytest
from pythonfmu.builder import FmuBuilder

from swarmwright import Experiment, InputError, optimize
from swarmwright.simulations.command.fmu import make_parameters
from swarmwright.simulations.command.fmu_definition import FmuOptions
from swarmwright.simulations.fmu.description import describe
from swarmwright.simulations.fmu.instances import FmuError, Instance, unpack
from swarmwright.simulations.fmu.program import Episodes
from swarmwright.simulations.parameters import fill_parameters
from tests.python.simulations.fmu.built import build
from tests.python.simulations.fmu.conftest import SOURCES

pytestmark = pytest.mark.slow  # compiles FMUs

TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Types" instantiationToken="types">
<CoSimulation modelIdentifier="types"/>
<TypeDefinitions><EnumerationType name="Gear">
<Item name="back" value="-2"/><Item name="slow" value="1"/><Item name="fast" value="4"/>
</EnumerationType></TypeDefinitions>
<DefaultExperiment startTime="0" stopTime="1" stepSize="0.125"/>
<ModelVariables>
<UInt8 name="level" valueReference="1" causality="input" start="0"/>
<UInt8 name="bounded" valueReference="2" causality="input" start="0" min="10" max="20"/>
<UInt8 name="capped" valueReference="10" causality="input" start="0" max="50"/>
<Int8 name="small" valueReference="3" causality="input" start="0"/>
<UInt64 name="large" valueReference="4" causality="input" start="0"/>
<Enumeration name="gear" valueReference="5" causality="input" declaredType="Gear" start="1"/>
<Boolean name="flag" valueReference="6" causality="input" start="false"/>
<Boolean name="flags" valueReference="7" causality="input" start="false false">
<Dimension start="2"/></Boolean>
<UInt8 name="seed" valueReference="8" causality="parameter" variability="fixed" start="0"/>
<Enumeration name="first" valueReference="9" causality="parameter" variability="fixed" declaredType="Gear"
 start="1"/>
</ModelVariables><ModelStructure/></fmiModelDescription>"""

GEARS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Gears" guid="gears">
<CoSimulation modelIdentifier="gears"/>
<TypeDefinitions><SimpleType name="Gear"><Enumeration><Item name="slow" value="1"/><Item name="fast"/>
</Enumeration></SimpleType></TypeDefinitions>
<ModelVariables><ScalarVariable name="gear" valueReference="0" causality="input">
<Enumeration declaredType="Gear" start="1"/></ScalarVariable></ModelVariables>
<ModelStructure/></fmiModelDescription>"""

PULL = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Pull" instantiationToken="pull">
<ModelExchange modelIdentifier="pull"/>
<DefaultExperiment startTime="0" stopTime="1" stepSize="0.125"/>
<ModelVariables>
<Float64 name="time" valueReference="9" causality="independent" variability="continuous"/>
<Float64 name="place1" valueReference="0" causality="output" initial="exact" start="0"/>
<Float64 name="place2" valueReference="1" causality="output" initial="exact" start="0"/>
<Float64 name="speed" valueReference="2" causality="input" start="0 0"><Dimension start="2"/></Float64>
<Float64 name="der(place1)" valueReference="4" derivative="0"/>
<Float64 name="der(place2)" valueReference="5" derivative="1"/>
</ModelVariables>
<ModelStructure><Output valueReference="0"/><Output valueReference="1"/>
<ContinuousStateDerivative valueReference="4"/><ContinuousStateDerivative valueReference="5"/>
</ModelStructure></fmiModelDescription>"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with Types3.fmu, Pull3.fmu and Switches.fmu."""
    folder = tmp_path_factory.mktemp("values")
    build(folder, "types", TYPES)
    build(folder, "pull", PULL)
    FmuBuilder.build_FMU(SOURCES / "switches.py", dest=folder)
    return folder


def episodes(file: Path, **options: Any) -> Episodes:
    """Episodes in this process, in a folder of their own."""
    made = FmuOptions(fmu=str(file), **options)
    assert not made.problems()
    with contextlib.chdir(tempfile.mkdtemp(dir=file.parent)):
        return Episodes(made.attachment())


def refused(file: Path, **options: Any) -> str:
    """What is wrong with a definition."""
    with pytest.raises(InputError) as caught:
        Experiment.from_mapping({"simulation": {"fmu": str(file), **options}, "fitness": "0"})
    return str(caught.value).replace(f"{file.parent}/", "")


def set_by(file: Path, actuator: str | dict[str, Any], *values: float) -> list[list[float]]:
    """What a variable of an FMU holds after steps in which its actuators, all alike, have these values."""
    name = actuator if isinstance(actuator, str) else actuator["variable"]
    stepped = episodes(file, sensors=[name], actuators=[actuator])
    found = stepped.reset({}, 1)["sensors"][0]
    return [stepped.step([[value] * len(found)])["sensors"][0] for value in values]


@pytest.mark.slow
def test_agents_in_one_instance_for_model_exchange(files: Path) -> None:
    """Each of them sets its own input, also where it is equal to another's."""
    pull = episodes(files / "Pull3.fmu", agents=2, sensors=["place{agent}"], actuators=["speed[{agent}]"])
    places = [0.0, 0.0]
    pull.reset({}, 1)
    for speeds in ((0.5, 0.5), (0.5, -1.0), (-1.0, -1.0), (-1.0, 0.5), (-1.0, 0.5)):
        found = pull.step([[speed] for speed in speeds])["sensors"]
        places = [place + 0.125 * speed for place, speed in zip(places, speeds, strict=True)]
        assert [one for (one,) in found] == pytest.approx(places)


def test_booleans_are_true_above_zero(files: Path) -> None:
    """With a range, above its middle, which is 0 of the actuator; in arrays, too."""
    values, expected = (-1.0, -0.6, 0.0, 0.2, 0.6, 1.0, -0.2), [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0]
    assert set_by(files / "Switches.fmu", "gate", *values) == [[one] for one in expected]
    assert set_by(files / "Types3.fmu", "flag", *values) == [[one] for one in expected]
    assert set_by(files / "Types3.fmu", "flags", *values) == [[one, one] for one in expected]
    ranged = {"variable": "flag", "range": [3.0, 9.0]}
    assert set_by(files / "Types3.fmu", ranged, *values) == [[one] for one in expected]


@pytest.mark.parametrize(
    ("file", "name", "limits", "expected"),
    [
        ("Types3", "level", [-100.0, 300.0], [0.0, 100.0, 255.0]),
        ("Types3", "small", [-300.0, 300.0], [-128.0, 0.0, 127.0]),
        ("Types3", "large", [0.0, 1e30], [0.0, 2.0**64, 2.0**64]),
        ("Types3", "bounded", None, [10.0, 15.0, 20.0]),
        ("Types3", "capped", None, [0.0, 25.0, 50.0]),
        ("Switches", "mode", [-1e12, 1e12], [-(2.0**31), 0.0, 2.0**31 - 1]),
    ],
)
def test_integers_are_clipped_to_their_types(
    files: Path, file: str, name: str, limits: list[float] | None, expected: list[float]
) -> None:
    actuator = name if limits is None else {"variable": name, "range": limits}
    found = set_by(files / f"{file}.fmu", actuator, -1.0, 0.0, 1.0)
    assert [one for (one,) in found] == expected


def test_an_enumeration_has_its_items(files: Path) -> None:
    """Of -2, 1 and 4 the nearest one, where -1 to 1 is -2 to 4."""
    found = set_by(files / "Types3.fmu", "gear", -1.0, -0.6, -0.4, 0.0, 0.4, 0.6, 1.0)
    assert [one for (one,) in found] == [-2.0, -2.0, 1.0, 1.0, 1.0, 4.0, 4.0]


def test_an_enumeration_whose_items_have_no_values_has_none(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "gears.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", GEARS)
    assert describe(tmp_path / "gears.fmu").variables["gear"].items == ()


def test_a_seed_fits_its_type(files: Path) -> None:
    types = episodes(files / "Types3.fmu", sensors=["seed"], actuators=["small"])
    assert [types.reset({}, seed)["sensors"] for seed in (7, 255, 256, 2**40 + 3)] == [
        [[7.0]], [[255.0]], [[0.0]], [[3.0]],
    ]  # fmt: skip
    types = episodes(files / "Types3.fmu", sensors=["small"], actuators=["flag"], seed="small")
    assert [types.reset({}, seed)["sensors"] for seed in (127, 128)] == [[[127.0]], [[0.0]]]


def test_start_values_keep_their_types(files: Path) -> None:
    start = {"level": 200, "flag": 1, "flags": [False, True], "gear": 4, "small": -3.0, "large": 2**63}
    names = list(start)
    types = episodes(files / "Types3.fmu", sensors=names, actuators=["small"], start=start)
    assert types.reset({}, 0)["sensors"] == [[200.0, 1.0, 0.0, 1.0, 4.0, -3.0, 2.0**63]]


MISTAKES: tuple[tuple[str, dict[str, Any], str], ...] = (
    (
        "Switches",
        {"start": {"gain": "abc"}},
        "start.gain: gain of Switches.fmu is of the type Real, expected",
    ),
    ("Switches", {"start": {"gain": True}}, "expected a number, not true"),
    ("Switches", {"start": {"count": 2.7}}, "expected an integer from -2147483648 to 2147483647, not 2.7"),
    ("Switches", {"start": {"count": 2**31}}, "to 2147483647, not 2147483648"),
    ("Switches", {"start": {"on": "false"}}, "of the type Boolean, expected true or false, not 'false'"),
    ("Switches", {"start": {"on": 2}}, "of the type Boolean, expected true or false, not 2"),
    ("Switches", {"start": {"label": 1}}, "of the type String, expected a string, not 1"),
    ("Switches", {"seed": "label"}, "seed: label of Switches.fmu is of the type String; expected an integer"),
    ("Switches", {"seed": "on"}, "seed: on of Switches.fmu is of the type Boolean; expected an integer"),
    ("Types3", {"seed": "gear"}, "seed: gear of Types3.fmu is of the type Enumeration; expected an integer"),
    ("Types3", {"seed": "flags"}, "seed: flags of Types3.fmu is an array; expected an integer"),
    ("Types3", {"start": {"level": 300}}, "of the type UInt8, expected an integer from 0 to 255, not 300"),
    ("Types3", {"start": {"gear": 2}}, "of the type Enumeration, expected one of -2, 1, 4, not 2"),
    ("Types3", {"start": {"flags": [True, "no"]}}, "of the type Boolean, expected true or false, not 'no'"),
    (
        "Types3",
        {"sensors": ["small"], "actuators": ["flag", "level"]},
        "actuators[1]: level of Types3.fmu is of the type UInt8, without min and max; write the range",
    ),
    (
        "Types3",
        {"sensors": ["small"]},
        "simulation.actuators: is missing: level of Types3.fmu is of the type",
    ),
)


@pytest.mark.parametrize(("name", "values", "said"), MISTAKES, ids=[said[:40] for _, _, said in MISTAKES])
def test_mistakes(files: Path, name: str, values: dict[str, Any], said: str) -> None:
    told = refused(files / f"{name}.fmu", **values)
    assert said in told, told


def test_parameters_have_the_limits_of_their_types(files: Path) -> None:
    """0 and 1 of a parameter set are a boolean."""
    known = make_parameters(FmuOptions(fmu=str(files / "Switches.fmu")))
    assert {name: one.kind for name, one in known.items()} == {
        "gain": "number", "count": "integer", "on": "boolean", "label": "string",
    }  # fmt: skip
    given = {"gain": 2, "count": 4.0, "on": 0, "label": "y"}
    found = fill_parameters(known, given)
    assert found == {"gain": 2.0, "count": 4, "on": False, "label": "y"}
    assert [type(one) for one in found.values()] == [float, int, bool, str]
    assert fill_parameters(known, {}) == {"gain": 1.0, "count": 3, "on": True, "label": "x"}
    for name, value, said in (
        ("count", 3_000_000_000, "3000000000 found, expected an integer from -2147483648 to 2147483647"),
        ("count", True, "True found, expected an integer"),
        ("on", 2, "2 found, expected true or false"),
        ("on", "false", "'false' found, expected true or false"),
        ("label", 2, "2 found, expected a string"),
    ):
        with pytest.raises(InputError, match=f"{name}: {said}"):
            fill_parameters(known, {name: value})
    items = make_parameters(FmuOptions(fmu=str(files / "Types3.fmu")))
    assert set(items) == {"first"}
    with pytest.raises(InputError, match="first: 3 found, expected one of -2, 1, 4"):
        fill_parameters(items, {"first": 3})


def test_messages_of_an_fmu(files: Path, tmp_path: Path) -> None:
    """The last one says why a step fails; those that all is well are not printed, and warnings end."""
    log, known = io.StringIO(), describe(files / "Types3.fmu")
    types = Instance(known, unpack(str(files / "Types3.fmu"), tmp_path), "types", log)
    types.begin({}, 0.0, 200.0)
    for step in range(1100):
        types.step(0.125 * step, 0.125)
    types.put([known.variables["level"]], [13.0])
    with pytest.raises(FmuError, match=r"the step from 137\.5 s: 13 is a bad number"):
        types.step(137.5, 0.125)
    assert log.getvalue().splitlines() == [
        *["the step was hard"] * 1000, "further warnings of this FMU are omitted", "13 is a bad number",
    ]  # fmt: skip
    types.end()


def test_an_end_of_several_lines(files: Path) -> None:
    done = "total > 30  # at last\n  or  # it is\n  total < -5\n"
    switches = episodes(files / "Switches.fmu", start={"count": 0}, sensors=["total"], done=done)
    switches.reset({}, 1)
    assert ["done" in switches.step([[0.0, 0.0]]) for _ in range(4)] == [False, False, False, True]


def evolved(file: Path, parameters: dict[str, Any]) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": {"fmu": str(file), "steps": 5},
            "fitness": "total",
            "controller": {"kind": "parameter_set", "parameters": parameters},
            "method": {"kind": "nnga", "population": 8, "generations": 2},
        }
    )


@pytest.mark.slow
def test_a_boolean_is_evolved_by_0_and_1(files: Path, tmp_path: Path) -> None:
    """Its total is ten times as large where it is on."""
    two = {"type": "integer", "range": [0, 1]}
    run = optimize(
        evolved(files / "Switches.fmu", {"count": {"type": "integer", "range": [1, 9]}, "on": two}),
        servers="local",
        out=tmp_path / "run",
    )
    assert run.best.controller.parameters["on"] == 1
    assert run.best.fitness == (1.0 + run.best.controller.parameters["count"]) * 10.0 * 5
    with pytest.raises(InputError) as caught:
        evolved(files / "Switches.fmu", {"count": two, "on": {"type": "integer", "range": [0, 2]}})
    assert "controller.parameters.on: " in str(caught.value)
    assert "refuses 2: 2 found, expected true or false" in str(caught.value)
    assert "parameters.count" not in str(caught.value)


def test_parameters_of_an_experiment_fit_their_types(files: Path) -> None:
    for given, said in (
        (
            {"count": 3_000_000_000},
            "parameters.count: 3000000000 found, expected an integer from -2147483648",
        ),
        ({"on": "false"}, "parameters.on: 'false' found, expected true or false"),
    ):
        with pytest.raises(InputError, match=said):
            Experiment.from_mapping(
                {
                    "simulation": {"fmu": str(files / "Switches.fmu"), "steps": 5},
                    "fitness": "total",
                    "parameters": given,
                }
            )
