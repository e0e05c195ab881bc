"""Checks the files of a configuration: SUMO itself ends the process at a network that is not XML."""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

from swarmwright.core.errors import InputError

_INPUTS = ("net-file", "route-files", "additional-files")


def checked(config: str) -> Path:
    """Return the path of a configuration whose network, routes and additional files can be read.

    Raises InputError, "config: why".
    """
    if not config:
        raise InputError(
            "config: missing; expected the path of a configuration of SUMO, such as town.sumocfg"
        )
    path = Path(config).absolute()
    named = dict(_named(path))
    if "net-file" not in named:
        raise InputError(f"config: {path}: it names no net-file")
    for files in named.values():
        for file in files:
            _parse(file)
    return path


def _named(config: Path) -> Iterator[tuple[str, list[Path]]]:
    for element in _parse(config).iter():
        name = {"n": "net-file", "net": "net-file", "r": "route-files", "a": "additional-files"}.get(
            element.tag, element.tag
        )
        if name in _INPUTS:
            text = element.get("value") or element.get("v") or ""
            yield name, [config.parent / word for word in text.replace(",", " ").split()]


def _parse(path: Path) -> ET.Element:
    """Return the root of an XML file; an empty one where it is compressed, which SUMO reads, too."""
    try:
        with path.open("rb") as file:
            if file.read(2) == b"\x1f\x8b":
                return ET.Element("compressed")
            file.seek(0)
            return ET.parse(file).getroot()  # noqa: S314 - the user has SUMO read it, too
    except OSError as error:
        raise InputError(f"config: {path}: {error.strerror}") from None
    except ET.ParseError as error:
        raise InputError(f"config: {path}: not valid XML: {error}") from None
