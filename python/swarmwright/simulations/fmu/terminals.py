"""Terminals of FMI 3.0: variables that belong together, such as the pins of a connector."""

from collections.abc import Iterator, Mapping
from xml.etree import ElementTree as ET


def terminals_of(text: bytes) -> Mapping[str, tuple[str, ...]]:
    """Return terminal -> its variables, in their order.

    Those of terminals within one belong to it, too, and have names such as robot.wheels. FMI 3.0, section
    2.4.9. Raises ET.ParseError for text that is not XML.
    """
    root = ET.fromstring(text)  # noqa: S314 - expat limits entities
    return {
        name: tuple(members)
        for one in root.findall("Terminals/Terminal")
        for name, members in _terminals_in(one, "")
    }


def _terminals_in(terminal: ET.Element, above: str) -> Iterator[tuple[str, list[str]]]:
    name = f"{above}{terminal.get('name', '')}"
    members = []
    for one in terminal:
        if one.tag == "TerminalMemberVariable":
            members.append(one.get("variableName", ""))
        elif one.tag == "Terminal":
            for inner, variables in _terminals_in(one, f"{name}."):
                if "." not in inner[len(name) + 1 :]:
                    members += variables
                yield inner, variables
    yield name, members
