"""Writes SSPs: several FMUs as one system."""

import io
import re
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from swarmwright.common.errors import InputError
from swarmwright.simulations.fmu.description import Description, Variable, for_coupling
from swarmwright.simulations.fmu.ssp import STRUCTURE, System, checked, conversion
from swarmwright.simulations.fmu.units import Unit, units_of

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_DATE = (1980, 1, 1, 0, 0, 0)
"""Of all entries, so that the same system gives the same bytes."""
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_KINDS = {"parameter": "parameter", "input": "input", "output": "output"}


def component_files(words: Sequence[str]) -> dict[str, Path]:
    """Return the file of each component: `FILE.fmu`, which is named by its file, or `NAME=FILE.fmu`.

    Raises InputError for a name that is taken or has other characters than letters, digits and _.
    """
    files: dict[str, Path] = {}
    for word in words:
        name, equals, file = word.partition("=")
        path = Path(file if equals else word)
        name = name if equals else path.stem
        if not _NAME.fullmatch(name):
            raise InputError(
                f"{word}: {name!r} is not a valid name of a component, expected letters, digits and _; "
                f"name it, NAME={path}"
            )
        if name in files:
            raise InputError(f"{word}: there is a component {name} already; name this one, OTHER={path}")
        files[name] = path
    return files


def coupled(name: str, files: Mapping[str, Path], connections: Sequence[str]) -> tuple[bytes, dict[str, str]]:
    """Return an SSP 1.0 of FMUs, the same bytes for the same FMUs, and by connection how it is scaled.

    A variable that Swarmwright exported with a range is -1 to 1; a connection with one in physical units gets
    a linear transformation.

    Args:
        name: of the system.
        files: by component, in the order in which gauss_seidel steps them.
        connections: `component.output:component.input` each.

    Raises InputError for unknown names, for wrong causalities, for an input that is connected twice, and for
    units that cannot be converted.
    """
    components = {component: for_coupling(file) for component, file in files.items()}
    system = System(name, {}, components, (), {})
    root = ET.Element(f"{{{_SSD}}}SystemStructureDescription", {"version": "1.0", "name": name})
    top = ET.SubElement(root, f"{{{_SSD}}}System", name=name)
    elements = ET.SubElement(top, f"{{{_SSD}}}Elements")
    for component, known in components.items():
        about = {
            "name": component,
            "source": f"resources/{component}.fmu",
            "type": "application/x-fmu-sharedlibrary",
        }
        one = ET.SubElement(elements, f"{{{_SSD}}}Component", about)
        _add_connectors(ET.SubElement(one, f"{{{_SSD}}}Connectors"), known)
    scaled: dict[str, str] = {}
    if connections:
        listed = ET.SubElement(top, f"{{{_SSD}}}Connections")
        taken: dict[str, str] = {}
        for text in connections:
            start, end = _ends(text)
            first, last = checked(system, start, end)
            by, words = _scaling(system, start, end, first, last)
            if end in taken:
                raise InputError(f"{text}: {end} is connected already, to {taken[end]}")
            taken[end] = start
            one = ET.SubElement(listed, f"{{{_SSD}}}Connection", _attributes(start, end))
            if by is not None:
                one.set("suppressUnitConversion", "true")  # it is part of the transformation
                about = {"factor": repr(by[0]), "offset": repr(by[1])}
                ET.SubElement(one, f"{{{_SSC}}}LinearTransformation", about)
                scaled[text] = words
    _add_units(root, components)
    ET.register_namespace("ssd", _SSD)
    ET.register_namespace("ssc", _SSC)
    ET.indent(root)
    text = f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
    contents = {STRUCTURE: text.encode()}
    contents |= {f"resources/{component}.fmu": file.read_bytes() for component, file in files.items()}
    return _zipped(contents), scaled


def _scaling(
    system: System, start: str, end: str, first: Variable, last: Variable
) -> tuple[tuple[float, float] | None, str]:
    """Return factor and offset between a scaled variable and one that is not, and words; None for others.

    Raises InputError for units that cannot be converted.
    """
    one, other = first.stands_for, last.stands_for
    units = [variable.unit if of is None else of.unit for variable, of in ((first, one), (last, other))]
    found = conversion(system, start, end, units[0], units[1], {})
    factor, offset = found.factor, found.offset
    if one == other or not (_is_known(first) and _is_known(last)):
        return None, ""
    words = []
    if one is not None:
        by = one.to_value
        factor, offset = factor * by[0], factor * by[1] + offset
        words.append(f"{start} is {one.scaled_words}")
    if other is not None:
        by = other.from_value
        factor, offset = factor * by[0], by[0] * offset + by[1]
        words.append(f"{end} is {other.scaled_words}")
    return (factor, offset), ", ".join(words)


def _is_known(variable: Variable) -> bool:
    """Whether a variable says what it is scaled from, or shows by unit or limits that it is not scaled.

    Others may be scaled, as FMUs of other tools are that do not say so.
    """
    limits = variable.minimum, variable.maximum
    return variable.stands_for is not None or bool(variable.unit) or limits not in ((None, None), (-1.0, 1.0))


def _ends(text: str) -> tuple[str, str]:
    start, colon, end = text.partition(":")
    if not colon or "." not in start or "." not in end:
        raise InputError(f"{text}: expected COMPONENT.OUTPUT:COMPONENT.INPUT, such as world.x:radio.x")
    return start, end


def _attributes(start: str, end: str) -> dict[str, str]:
    first, last = start.partition("."), end.partition(".")
    return {
        "startElement": first[0],
        "startConnector": first[2],
        "endElement": last[0],
        "endConnector": last[2],
    }


def _add_connectors(parent: ET.Element, known: Description) -> None:
    for variable in known.variables.values():
        if variable.causality not in _KINDS or variable.is_array:
            continue
        connector = ET.SubElement(
            parent, f"{{{_SSD}}}Connector", name=variable.name, kind=_KINDS[variable.causality]
        )
        kind = _type(variable)
        unit = {"unit": variable.unit} if variable.unit and kind == "Real" else {}
        ET.SubElement(connector, f"{{{_SSC}}}{kind}", unit)


def _type(variable: Variable) -> str:
    """Return the type of a connector; enumerations are written as their numbers."""
    if variable.is_real:
        return "Real"
    return variable.type if variable.type in ("Boolean", "String", "Binary") else "Integer"


def _add_units(root: ET.Element, components: Mapping[str, Description]) -> None:
    found: dict[str, Unit] = {}
    for known in components.values():
        found |= units_of(known.units)
    if not found:
        return
    listed = ET.SubElement(root, f"{{{_SSD}}}Units")
    for name, unit in sorted(found.items()):
        one = ET.SubElement(listed, f"{{{_SSC}}}Unit", name=name)
        ET.SubElement(one, f"{{{_SSC}}}BaseUnit", unit.attributes())


def _zipped(contents: Mapping[str, bytes]) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in contents.items():
            info = zipfile.ZipInfo(name, _DATE)
            info.compress_type = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, content)
    return data.getvalue()
