"""Shared parts of exported FMUs: archives, units, names, XML."""

import hashlib
import io
import re
import zipfile
from collections.abc import Iterable
from xml.etree import ElementTree as ET

from swarmwright.common.ranges import Range
from swarmwright.controllers.source.text import make_identifiers, plain
from swarmwright.export._base import Files, file_bytes
from swarmwright.simulations.fmu.description import RANGE

_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of all entries, for reproducible archives."""
UNITS: dict[str, dict[str, str]] = {
    "m": {"m": "1"}, "s": {"s": "1"}, "rad": {"rad": "1"}, "m/s": {"m": "1", "s": "-1"},
    "rad/s": {"rad": "1", "s": "-1"}, "m/s^2": {"m": "1", "s": "-2"}, "kg": {"kg": "1"}, "Hz": {"s": "-1"},
    "V": {"kg": "1", "m": "2", "s": "-3", "A": "-1"}, "K": {"K": "1"},
    "N": {"kg": "1", "m": "1", "s": "-2"}, "W": {"kg": "1", "m": "2", "s": "-3"},
    "deg": {"rad": "1", "factor": "0.017453292519943295"},
    "m^2": {"m": "2"}, "m^3": {"m": "3"}, "rad/s^2": {"rad": "1", "s": "-2"}, "A": {"A": "1"},
    "Pa": {"kg": "1", "m": "-1", "s": "-2"}, "J": {"kg": "1", "m": "2", "s": "-2"},
    "N.m": {"kg": "1", "m": "2", "s": "-2"}, "Nm": {"kg": "1", "m": "2", "s": "-2"},
    "ohm": {"kg": "1", "m": "2", "s": "-3", "A": "-2"}, "T": {"kg": "1", "s": "-2", "A": "-1"},
    "lx": {"cd": "1", "m": "-2"}, "%": {"factor": "0.01"},
    "min": {"s": "1", "factor": "60.0"}, "h": {"s": "1", "factor": "3600.0"},
    "deg/s": {"rad": "1", "s": "-1", "factor": "0.017453292519943295"},
    "degC": {"K": "1", "offset": "273.15"},
}  # fmt: skip
"""Units in SI base units, spelled in ASCII; other units are only named, as is g, which is either a gram or
9.81 m/s^2."""
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
_PREFIXED = ("m", "s", "V", "A", "N", "W", "Hz", "Pa", "J", "N.m", "ohm", "T", "rad")
"""Units with SI prefixes."""
_NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def unit_name(unit: str) -> str:
    """Return the name of a unit in FMUs: deg for degrees, without line breaks."""
    return " ".join(unit.replace("\N{DEGREE SIGN}", "deg").split())


def add_units(root: ET.Element, names: Iterable[str]) -> None:
    """Add the definitions of units, in SI base units if known."""
    units = ET.SubElement(root, "UnitDefinitions")
    for name in names:
        unit = ET.SubElement(units, "Unit", name=name)
        if base := _base_unit(name):
            ET.SubElement(unit, "BaseUnit", base)


def _base_unit(name: str) -> dict[str, str]:
    """Return a unit, such as `m/s²` or `kΩ`, in SI base units; empty if unknown."""
    spelled = plain(name)
    if spelled in UNITS:
        return UNITS[spelled]
    factor, rest = _PREFIXES.get(spelled[:1]), spelled[1:]
    if factor is None or rest not in _PREFIXED:
        return {}
    return {**UNITS[rest], "factor": repr(factor * float(UNITS[rest].get("factor", "1")))}


def add_range(variable: ET.Element, range_: Range, fmi: str) -> None:
    """Annotate a variable with the values of -1 and 1, see `simulations.fmu.description`."""
    annotations = ET.SubElement(variable, "Annotations")
    if fmi == "3.0":
        annotation = ET.SubElement(annotations, "Annotation", type=RANGE)
    else:
        annotation = ET.SubElement(annotations, "Tool", name=RANGE)
    about = {"low": repr(range_.low), "high": repr(range_.high)}
    ET.SubElement(annotation, "Range", about | ({"unit": unit} if (unit := unit_name(range_.unit)) else {}))


def name_variables(group: str, names: Iterable[str]) -> list[str]:
    """Return names of variables in FMI's structured convention: `sensors.goal_x` for `goal x`."""
    words = make_identifiers(names, group.rpartition(".")[2].removesuffix("s").upper())
    # A name of the convention does not begin with a digit.
    return [f"{group}.{'_' if name[0].isdigit() else ''}{name.lower()}" for name in words]


def token(*parts: str | bytes) -> str:
    """Return an identifier of the content of the archive, in the form of a GUID."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode() if isinstance(part, str) else part)
    text = digest.hexdigest()[:32]
    return f"{{{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:]}}}"


def zip_files(files: Files, *, compressed: bool = True) -> bytes:
    """Return an archive; the mark of Swarmwright is uncompressed at its beginning.

    compressed: if False, the bytes do not depend on the version of zlib.
    """
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in files.items():
            info = zipfile.ZipInfo(name, _DATE)
            stored = name.endswith(".xml") or not compressed
            info.compress_type = zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, file_bytes(content))
    return data.getvalue()


def format_xml(root: ET.Element, comment: str = "") -> str:
    """Return a document with a comment before its root. Characters that XML forbids are replaced."""
    ET.indent(root)
    begin = f"<!-- {comment} -->\n" if comment else ""
    text = _NOT_IN_XML.sub("\N{REPLACEMENT CHARACTER}", ET.tostring(root, encoding="unicode"))
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{begin}{text}\n'
