"""What SSPs of other tools do to values: transformations of connections, parameter sets and mappings."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmwright import InputError
from swarmwright.simulations.fmu.program import Coupled
from swarmwright.simulations.fmu.ssp import describe, read_system
from tests.python.simulations.fmu.built import build

pytestmark = pytest.mark.slow  # compiles FMUs

_SSP = "http://ssp-standard.org/SSP1/SystemStructure"
PASS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Pass" guid="pass"><CoSimulation modelIdentifier="pass"/>
<UnitDefinitions><Unit name="m"><BaseUnit m="1"/></Unit><Unit name="km"><BaseUnit m="1" factor="1000"/></Unit>
<Unit name="s"><BaseUnit s="1"/></Unit></UnitDefinitions>
<TypeDefinitions><SimpleType name="Gear"><Enumeration><Item name="back" value="-1"/>
<Item name="park" value="0"/><Item name="drive" value="1"/></Enumeration></SimpleType>
<SimpleType name="Mode"><Enumeration><Item name="off" value="10"/><Item name="park" value="1"/>
<Item name="on" value="2"/></Enumeration></SimpleType></TypeDefinitions><ModelVariables>
<ScalarVariable name="r" valueReference="0" causality="input"><Real start="0" unit="m"/></ScalarVariable>
<ScalarVariable name="r_out" valueReference="1" causality="output"><Real unit="km"/></ScalarVariable>
<ScalarVariable name="t" valueReference="2" causality="input"><Real start="0" unit="s"/></ScalarVariable>
<ScalarVariable name="i" valueReference="0" causality="input"><Integer start="0"/></ScalarVariable>
<ScalarVariable name="i_out" valueReference="1" causality="output"><Integer/></ScalarVariable>
<ScalarVariable name="b" valueReference="0" causality="input"><Boolean start="0"/></ScalarVariable>
<ScalarVariable name="b_out" valueReference="1" causality="output"><Boolean/></ScalarVariable>
<ScalarVariable name="gear" valueReference="2" causality="input">
<Enumeration declaredType="Gear" start="0"/></ScalarVariable>
<ScalarVariable name="gear_out" valueReference="3" causality="output">
<Enumeration declaredType="Gear"/></ScalarVariable>
<ScalarVariable name="mode" valueReference="4" causality="input">
<Enumeration declaredType="Mode" start="1"/></ScalarVariable>
</ModelVariables><ModelStructure><Outputs><Unknown index="2"/><Unknown index="5"/><Unknown index="7"/>
<Unknown index="9"/></Outputs></ModelStructure></fmiModelDescription>"""


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("pass"), "pass", PASS)


Make = Callable[..., Path]


@pytest.fixture
def make(fmu: Path, tmp_path: Path) -> Make:
    def made(connections: str = "", system: str = "", a: str = "", after: str = "", **files: str) -> Path:
        """Write an SSP of a and b; `system` and `a` are parameter bindings, and `files` other files."""
        parts = "".join(
            f'<d:Component name="{name}" source="resources/pass.fmu">{bound}</d:Component>'
            for name, bound in (("a", a), ("b", ""))
        )
        listed = f"<d:Connections>{connections}</d:Connections>" if connections else ""
        text = (
            f'<d:SystemStructureDescription xmlns:d="{_SSP}Description" xmlns:c="{_SSP}Common" '
            f'xmlns:v="{_SSP}ParameterValues" xmlns:m="{_SSP}ParameterMapping" version="1.0" name="x">'
            f'<d:System name="x">{system}<d:Elements>{parts}</d:Elements>{listed}</d:System>{after}'
            "</d:SystemStructureDescription>"
        )
        file = tmp_path / "system.ssp"
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("SystemStructure.ssd", text)
            archive.write(fmu, "resources/pass.fmu")
            for name, content in files.items():
                archive.writestr(f"resources/{name}.{name[:3]}", content)
        return file

    return made


def connected(start: str, end: str, inside: str = "", **attributes: str) -> str:
    words = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    return (
        f'<d:Connection startElement="a" startConnector="{start}" endElement="b" '
        f'endConnector="{end}" {words}>{inside}</d:Connection>'
    )


def table(kind: str, **entries: str) -> str:
    """Return a mapping transformation; names of entries that are numbers begin with n."""
    inside = "".join(
        f'<c:MapEntry source="{source.removeprefix("n")}" target="{target}"/>'
        for source, target in entries.items()
    )
    return f"<c:{kind}MappingTransformation>{inside}</c:{kind}MappingTransformation>"


def binding(parameters: str, mapping: str = "", units: str = "", **attributes: str) -> str:
    words = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    entries = f"<d:ParameterMapping>{mapped(mapping)}</d:ParameterMapping>" if mapping else ""
    return (
        f"<d:ParameterBindings><d:ParameterBinding {words}><d:ParameterValues>{values(parameters, units)}"
        f"</d:ParameterValues>{entries}</d:ParameterBinding></d:ParameterBindings>"
    )


def values(parameters: str, units: str = "") -> str:
    named = f'xmlns:v="{_SSP}ParameterValues" xmlns:c="{_SSP}Common"'
    listed = f"<v:Parameters>{parameters}</v:Parameters>{units}"
    return f'<v:ParameterSet {named} version="1.0" name="p">{listed}</v:ParameterSet>'


def mapped(entries: str) -> str:
    named = f'xmlns:m="{_SSP}ParameterMapping" xmlns:c="{_SSP}Common"'
    return f'<m:ParameterMapping {named} version="1.0">{entries}</m:ParameterMapping>'


def parameter(name: str, kind: str, value: str, unit: str = "") -> str:
    about = f' unit="{unit}"' if unit else ""
    return f'<v:Parameter name="{name}"><v:{kind} value="{value}"{about}/></v:Parameter>'


def after_a_step(file: Path, folder: Path, start: dict[str, float], *names: str) -> list[float]:
    system, known = Coupled(str(file), read_system(file), folder, "gauss_seidel"), describe(file).variables
    system.begin(start, 0.0, 1.0)
    system.step(0.0, 0.1)
    found = system.numbers([known[name] for name in names])
    system.end()
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("connection", "start", "expected"),
    [
        (connected("i_out", "i", table("Integer", n1="5")), {"a.i": 1}, {"b.i_out": 5}),
        (connected("i_out", "i", table("Integer", n1="5")), {"a.i": 2}, {"b.i_out": 2}),
        (
            connected("b_out", "b", table("Boolean", true="false", false="true")),
            {"a.b": True},
            {"b.b_out": 0},
        ),
        (connected("b_out", "b", table("Boolean", true="false", false="true")), {}, {"b.b_out": 1}),
        (
            connected("gear_out", "mode", table("Enumeration", back="off", park="park", drive="on")),
            {"a.gear": -1},
            {"b.mode": 10},
        ),
        (
            connected("gear_out", "mode", table("Enumeration", back="off", park="park", drive="on")),
            {},
            {"b.mode": 1},
        ),
        (connected("r_out", "r"), {"a.r": 0.5}, {"b.r": 500}),
        (
            connected("r_out", "r", '<c:LinearTransformation factor="2" offset="1"/>'),
            {"a.r": 0.5},
            {"b.r": 1001},
        ),
        (
            connected(
                "r_out",
                "r",
                '<c:LinearTransformation factor="2" offset="1"/>',
                suppressUnitConversion="true",
            ),
            {"a.r": 0.5},
            {"b.r": 2},
        ),
        (connected("r_out", "t", '<c:LinearTransformation factor="2"/>'), {"a.r": 0.5}, {"b.t": 1}),
        (
            '<d:Connection startElement="b" startConnector="i" endElement="a" endConnector="i_out"/>',
            {"a.i": 7},
            {"b.i_out": 7},
        ),
    ],
)
def test_transformations_of_connections(
    make: Make, tmp_path: Path, connection: str, start: dict[str, float], expected: dict[str, float]
) -> None:
    """Values without an entry are kept; units are converted before; variables say where data flows."""
    assert after_a_step(make(connection), tmp_path / "work", start, *expected) == list(expected.values())


@pytest.mark.parametrize(
    ("connection", "expected"),
    [
        (
            connected("b_out", "i", table("Integer", n1="5")),
            "is for variables of the type Integer or Enumeration, but b_out has the type Boolean",
        ),
        (
            connected("i_out", "i", table("Integer", n1="5", n01="6")),
            "the IntegerMappingTransformation has two entries with the source '01'",
        ),
        (
            connected("gear_out", "mode", table("Enumeration", back="of", park="park", drive="on")),
            "has an entry with 'of', which is not a value; mode has park, on, off",
        ),
        (
            connected("gear_out", "mode", table("Enumeration", park="park", drive="on")),
            "the EnumerationMappingTransformation keeps back, -1, but mode is one of 1, 2, 10; add an entry",
        ),
        (
            connected("i_out", "mode", table("Integer", n1="5")),
            "the IntegerMappingTransformation has the target 5, but mode is one of 1, 2, 10",
        ),
    ],
)
def test_mistakes_in_transformations(make: Make, connection: str, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        read_system(make(connection))
    assert "SystemStructure.ssd: the connection from a." in str(caught.value)
    assert expected in str(caught.value)


def entry(source: str, target: str, inside: str = "", **attributes: str) -> str:
    words = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    return f'<m:MappingEntry source="{source}" target="{target}" {words}>{inside}</m:MappingEntry>'


KM = '<v:Units><c:Unit name="mile"><c:BaseUnit m="1" factor="1609"/></c:Unit></v:Units>'


def test_values_of_parameter_sets(make: Make) -> None:
    """Of each type, in other units, with a prefix, and by mappings inline; some go to two variables."""
    parameters = (
        parameter("r", "Real", "2", "mile")
        + parameter("i", "Integer", "3")
        + parameter("b", "Boolean", "1")
        + parameter("gear", "Enumeration", "drive")
        + parameter("left out", "Integer", "1")
    )
    plain = make(a=binding(parameters.replace(parameter("left out", "Integer", "1"), ""), units=KM))
    assert read_system(plain).starts == {"a.r": 3218.0, "a.i": 3, "a.b": True, "a.gear": 1}
    entries = (
        entry("a.r", "a.r", '<c:LinearTransformation offset="1"/>')
        + entry("a.r", "b.r", suppressUnitConversion="true")
        + entry("a.i", "a.i", table("Integer", n3="-4"))
        + entry("a.b", "b.b", table("Boolean", true="false"))
        + entry("a.gear", "b.gear", table("Enumeration", drive="back"))
    )
    system = make(system=binding(parameters, entries, KM, prefix="a."))
    assert read_system(system).starts == {"a.r": 3219.0, "b.r": 2.0, "a.i": -4, "b.b": False, "b.gear": -1}


def test_files_of_parameters(make: Make) -> None:
    source = (
        '<d:ParameterBindings><d:ParameterBinding source="resources/ssv.ssv"><d:ParameterMapping '
        'source="resources/ssm.ssm"/></d:ParameterBinding></d:ParameterBindings>'
    )
    files = {
        "ssv": values(parameter("x", "Integer", "1")),
        "ssm": mapped(entry("x", "i", table("Integer", n1="8"))),
    }
    assert read_system(make(a=source, **files)).starts == {"a.i": 8}
    with pytest.raises(InputError, match=r"ParameterBinding resources/ssv\.ssv: files inside components"):
        read_system(make(a=source.replace('ssv.ssv"', 'ssv.ssv" sourceBase="component"'), **files))


def test_the_value_of_the_system_counts(make: Make, caplog: pytest.LogCaptureFixture) -> None:
    """As SSP has it; names without a variable are ignored, with a warning."""
    names = parameter("a.i", "Integer", "1") + parameter("a.lost", "Real", "1")
    file = make(system=binding(names), a=binding(parameter("i", "Integer", "2")))
    assert read_system(file).starts == {"a.i": 1}
    assert "parameter sets have values for a.lost, which are not variables and are ignored" in caplog.text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (parameter("r", "Real", "2", "s"), "a.r [m]: a value in s: these units are of different quantities"),
        (parameter("r", "Real", "2", "inch"), "a.r [m]: a value in inch: the unit inch is not defined"),
        (
            parameter("gear", "Enumeration", "up"),
            "a.gear: the value 'up' is not of the type Enumeration, one of",
        ),
        (parameter("i", "Real", "0.5"), "a.i: the value '0.5' is not of the type Integer"),
        (parameter("b", "String", "yes"), "a.b: the value 'yes' is not of the type Boolean"),
    ],
)
def test_values_that_do_not_fit(make: Make, text: str, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        read_system(make(a=binding(text)))
    assert expected in str(caught.value)


def test_the_default_experiment(make: Make) -> None:
    file = make(after='<d:DefaultExperiment startTime="2" stopTime="3.5"/>')
    assert (describe(file).start_time, describe(file).stop_time) == (2.0, 3.5)
