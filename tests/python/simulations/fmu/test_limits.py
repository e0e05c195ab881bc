"""FMUs and SSPs that are small, and would take gigabytes of memory or disk."""

import tracemalloc
import zipfile
from pathlib import Path

import pytest

from swarmwright import InputError
from swarmwright.common import archives
from swarmwright.simulations.fmu import description
from swarmwright.simulations.fmu.description import describe
from swarmwright.simulations.fmu.instances import FmuError, unpack
from swarmwright.simulations.fmu.ssp import read_system

MIB = 1 << 20


def fmu(file: Path, inside: str, variables: str = "", fmi: str = "2.0") -> Path:
    """Write an FMU with this inside its description, and 300 MiB of zeros where the name is bomb.fmu."""
    token = "guid" if fmi == "2.0" else "instantiationToken"
    text = (
        f'<fmiModelDescription fmiVersion="{fmi}" modelName="x" {token}="x">'
        '<CoSimulation modelIdentifier="x"/>'
        f"{inside}<ModelVariables>{variables}</ModelVariables><ModelStructure/></fmiModelDescription>"
    )
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", text)
        if file.name == "bomb.fmu":
            with archive.open("resources/table.csv", "w") as stream:
                for _ in range(300):
                    stream.write(bytes(MIB))
    return file


def test_what_an_fmu_unpacks_to(tmp_path: Path) -> None:
    file = fmu(tmp_path / "bomb.fmu", "")
    assert file.stat().st_size < MIB
    with pytest.raises(InputError, match=r"bomb\.fmu: unpacks to 300 MiB, more than 256 MiB"):
        describe(file)
    with pytest.raises(FmuError, match=r"cannot be unpacked: .*unpacks to 300 MiB"):
        unpack(str(file), tmp_path / "folder")
    assert not (tmp_path / "folder").exists()


@pytest.mark.parametrize(
    ("limit", "value", "expected"),
    [
        ("_LARGEST_XML_BYTES", 100, r"modelDescription\.xml has 0 MiB, more than 0 MiB, the limit"),
        ("_MOST_NODES", 20, r"modelDescription\.xml:1: <ScalarVariable>: the file has more than 20 elements"),
        ("_DEEPEST_NESTING", 2, r"modelDescription\.xml:1: <ScalarVariable>: nested more than 2 deep"),
        ("_MOST_VARIABLES", 9, r"modelDescription\.xml: has more than 9 variables and elements of arrays"),
    ],
)
def test_limits_of_descriptions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: int, expected: str
) -> None:
    variables = "".join(
        f'<ScalarVariable name="v{one}" valueReference="{one}"><Real/></ScalarVariable>' for one in range(10)
    )
    file = fmu(tmp_path / "x.fmu", "", variables)
    assert len(describe(file).variables) == 10
    monkeypatch.setattr(description, limit, value)
    description._describe.cache_clear()
    with pytest.raises(InputError, match=rf"x\.fmu: {expected}"):
        describe(file)


def test_elements_of_arrays_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(description, "_MOST_VARIABLES", 30)
    array = '<Float64 name="v{0}" valueReference="{0}"><Dimension start="10"/></Float64>'
    variables = "".join(array.format(one) for one in range(3))
    with pytest.raises(InputError, match="has more than 30 variables and elements of arrays"):
        describe(fmu(tmp_path / "x.fmu", "", variables, fmi="3.0"))


def test_entities_are_refused(tmp_path: Path) -> None:
    file = fmu(tmp_path / "x.fmu", "<UnitDefinitions>&a;</UnitDefinitions>")
    with zipfile.ZipFile(file) as archive:
        text = archive.read("modelDescription.xml")
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(
            "modelDescription.xml", b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + text
        )
    with pytest.raises(InputError, match=r"modelDescription\.xml:1: uses the entity a of a DTD"):
        describe(file)


@pytest.mark.slow
def test_many_units_and_items_take_little_memory(tmp_path: Path) -> None:
    """Neither the square of the units, nor all items of a type for each variable of it."""
    units = "".join(f'<Unit name="u{one}"><BaseUnit m="1" factor="{one + 1}"/></Unit>' for one in range(1000))
    items = "".join(f'<Item name="i{one}" value="{one}"/>' for one in range(1000))
    declared = f'<SimpleType name="E"><Enumeration>{items}</Enumeration></SimpleType>'
    inside = f"<UnitDefinitions>{units}</UnitDefinitions><TypeDefinitions>{declared}</TypeDefinitions>"
    variables = "".join(
        f'<ScalarVariable name="v{one}" valueReference="{one}"><Enumeration declaredType="E"/>'
        "</ScalarVariable>"
        for one in range(1000)
    )
    file = fmu(tmp_path / "x.fmu", inside, variables)
    tracemalloc.start()
    try:
        found = describe(file)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 30 * MIB
    assert found.conversions["u0"]["u1"] == (0.5, 0.0)
    assert found.variables["v0"].items is found.variables["v999"].items


def test_what_the_components_of_a_system_unpack_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each component is unpacked for itself, also where hundreds have one file."""
    inner = fmu(tmp_path / "x.fmu", f"<UnitDefinitions>{' ' * 10_000}</UnitDefinitions>")
    parts = "".join(f'<d:Component name="c{one}" source="resources/x.fmu"/>' for one in range(200))
    namespace = "http://ssp-standard.org/SSP1/SystemStructureDescription"
    file = tmp_path / "x.ssp"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(
            "SystemStructure.ssd",
            f'<d:SystemStructureDescription xmlns:d="{namespace}" version="1.0" name="x"><d:System name="x">'
            f"<d:Elements>{parts}</d:Elements></d:System></d:SystemStructureDescription>",
        )
        archive.write(inner, "resources/x.fmu")
    monkeypatch.setattr(archives, "_UNPACKED_BYTES", MIB)
    with pytest.raises(InputError, match=r"x\.ssp: its components unpack to 2 MiB, more than 1 MiB"):
        read_system(file)
