"""Export of SSPs: systems of several FMUs."""

import io
import re
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from swarmwright.common.errors import InputError
from swarmwright.simulations.fmu.description import Description, Variable, describe_for_coupling
from swarmwright.simulations.fmu.ssp import STRUCTURE, System, check_connection, conversion
from swarmwright.simulations.fmu.units import Unit, get_defined_units

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of all entries, so that the same system always gives the same bytes."""
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_KINDS = {"parameter": "parameter", "input": "input", "output": "output"}


def component_files(words: Sequence[str]) -> dict[str, Path]:
    """Return the file of each component, given as `FILE.fmu`, which is named by its file, or `NAME=FILE.fmu`.

    Raises InputError for duplicate names, and names with other characters than letters, digits and _.
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
            raise InputError(f"{word}: a component {name} already exists; write another name, OTHER={path}")
        files[name] = path
    return files


def write_system(
    name: str, files: Mapping[str, Path], connections: Sequence[str]
) -> tuple[bytes, dict[str, str]]:
    """Return an SSP 1.0 of FMUs, always the same bytes for the same FMUs, and a note for scaled connections.

    A variable that Swarmwright exported with a range is scaled to -1 to 1; its connection with a variable in
    physical units receives a linear transformation.

    Args:
        name: name of the system.
        files: file of each component, in the order in which gauss_seidel steps them.
        connections: connections `component.output:component.input`.

    Raises InputError for unknown names, wrong causalities, inputs that are connected twice, and units that
    cannot be converted.
    """
    components = {component: describe_for_coupling(file) for component, file in files.items()}
    system = System(name, {}, components, (), {})
    root = ET.Element(f"{{{_SSD}}}SystemStructureDescription", {"version": "1.0", "name": name})
    top = ET.SubElement(root, f"{{{_SSD}}}System", name=name)
    elements = ET.SubElement(top, f"{{{_SSD}}}Elements")
    for component, description in components.items():
        about = {
            "name": component,
            "source": f"resources/{component}.fmu",
            "type": "application/x-fmu-sharedlibrary",
        }
        component_element = ET.SubElement(elements, f"{{{_SSD}}}Component", about)
        _add_connectors(ET.SubElement(component_element, f"{{{_SSD}}}Connectors"), description)
    scaled: dict[str, str] = {}
    if connections:
        connection_list = ET.SubElement(top, f"{{{_SSD}}}Connections")
        sources: dict[str, str] = {}
        for text in connections:
            start, end = _split_connection(text)
            first, last = check_connection(system, start, end)
            scaling, words = _scaling(system, start, end, first, last)
            if end in sources:
                raise InputError(f"{text}: {end} is already connected to {sources[end]}")
            sources[end] = start
            component_element = ET.SubElement(
                connection_list, f"{{{_SSD}}}Connection", _attributes(start, end)
            )
            if scaling is not None:
                component_element.set("suppressUnitConversion", "true")  # it is part of the transformation
                about = {"factor": repr(scaling[0]), "offset": repr(scaling[1])}
                ET.SubElement(component_element, f"{{{_SSC}}}LinearTransformation", about)
                scaled[text] = words
    _add_units(root, components)
    ET.register_namespace("ssd", _SSD)
    ET.register_namespace("ssc", _SSC)
    ET.indent(root)
    text = f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
    contents = {STRUCTURE: text.encode()}
    contents |= {f"resources/{component}.fmu": file.read_bytes() for component, file in files.items()}
    return _zip_contents(contents), scaled


def _scaling(
    system: System, start: str, end: str, first: Variable, last: Variable
) -> tuple[tuple[float, float] | None, str]:
    """Return factor and offset between a scaled and an unscaled variable, and a note; None for other pairs.

    Raises InputError for units that cannot be converted.
    """
    start_range, end_range = first.stands_for, last.stands_for
    units = [
        variable.unit if range_ is None else range_.unit
        for variable, range_ in ((first, start_range), (last, end_range))
    ]
    unit_conversion = conversion(system, start, end, units[0], units[1], {})
    factor, offset = unit_conversion.factor, unit_conversion.offset
    if start_range == end_range or not (_is_known(first) and _is_known(last)):
        return None, ""
    words = []
    if start_range is not None:
        transform = start_range.to_value
        factor, offset = factor * transform[0], factor * transform[1] + offset
        words.append(f"{start} is {start_range.scaled_words}")
    if end_range is not None:
        transform = end_range.from_value
        factor, offset = factor * transform[0], transform[0] * offset + transform[1]
        words.append(f"{end} is {end_range.scaled_words}")
    return (factor, offset), ", ".join(words)


def _is_known(variable: Variable) -> bool:
    """Return whether it is known if a variable is scaled: by its range, its unit or its limits.

    Other variables may be scaled without declaring it, as in FMUs of other tools.
    """
    limits = variable.minimum, variable.maximum
    return variable.stands_for is not None or bool(variable.unit) or limits not in ((None, None), (-1.0, 1.0))


def _split_connection(text: str) -> tuple[str, str]:
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


def _add_connectors(parent: ET.Element, description: Description) -> None:
    for variable in description.variables.values():
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
    units: dict[str, Unit] = {}
    for description in components.values():
        units |= get_defined_units(description.units)
    if not units:
        return
    unit_list = ET.SubElement(root, f"{{{_SSD}}}Units")
    for name, unit in sorted(units.items()):
        unit_element = ET.SubElement(unit_list, f"{{{_SSC}}}Unit", name=name)
        ET.SubElement(unit_element, f"{{{_SSC}}}BaseUnit", unit.attributes())


def _zip_contents(contents: Mapping[str, bytes]) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in contents.items():
            info = zipfile.ZipInfo(name, _DATE)
            info.compress_type = zipfile.ZIP_STORED if name.endswith(".fmu") else zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, content)
    return data.getvalue()
