"""FREVO's problem descriptions: `<icomponent>` with config, properties and requirements.

Modelio's CPSwarm modules write such a file for the problem of a model; FREVO has one beside each component.
"""

from pathlib import Path

from swarmwright.common.xml import Element, read
from swarmwright.interop.models._parts import Location, Part, Problems, Property, parse_integer, parse_number

ROOTS = ("icomponent",)
WORDS = "a FREVO problem description (<icomponent>)"
_ENTRIES = {"config": "entry", "properties": "propentry", "requirements": "reqentry"}
_TYPES = ("INT", "LONG", "FLOAT", "DOUBLE", "BOOLEAN", "STRING", "ENUM", "FILE")


def load(path: Path) -> Part:
    """Read a problem description. Raises InputError with all problems, each with file and line."""
    root = read(path)
    problems = Problems()
    sections = _sections(path, root, problems)
    config = {key: element.attributes.get("value", "") for key, element in sections["config"].items()}
    part = Part(path, WORDS)
    class_name = config.get("classname", "").strip()
    name = config.get("name", "").strip()
    part.titles = tuple(
        title for title in (class_name.rpartition(".")[2], name) if title and title.lower() != "null"
    )
    part.name = part.titles[-1] if part.titles else ""
    if not part.titles:
        problems.add(
            Location(path, root.line, "<config>"),
            'has neither classname nor name; expected <entry key="classname" type="STRING" '
            'value="minisim.Minisim"/>',
        )
    for key, element in sections["properties"].items():
        value = _value(path, key, element, problems)
        if value is not None:
            part.properties.append(Property(key, value, _locate(path, key, element)))
    requirements = sections["requirements"]
    part.sensors = _count(path, requirements, "inputnumber", problems)
    part.actuators = _count(path, requirements, "outputnumber", problems)
    candidates = _count(path, requirements, "minimumCandidates", problems)
    if candidates is not None and candidates > 1:
        problems.add(
            _locate(path, "minimumCandidates", requirements["minimumCandidates"]),
            f"problems with {candidates} competing candidates are not supported; expected 1",
        )
    problems.stop()
    return part


def _sections(path: Path, root: Element, problems: Problems) -> dict[str, dict[str, Element]]:
    sections: dict[str, dict[str, Element]] = {name: {} for name in _ENTRIES}
    for section in root.children:
        if section.tag not in _ENTRIES:
            problems.add(
                Location(path, section.line, f"<{section.tag}>"),
                f"found inside <icomponent>; expected {', '.join(_ENTRIES)}",
            )
            continue
        for element in section.children:
            location = Location(path, element.line, f"<{element.tag}>")
            key = element.attributes.get("key", "")
            if element.tag != _ENTRIES[section.tag]:
                problems.add(location, f"found inside <{section.tag}>; expected <{_ENTRIES[section.tag]}>")
            elif not key:
                problems.add(location, "the attribute key is missing")
            elif "value" not in element.attributes:
                problems.add(location, f"the attribute value of {key!r} is missing")
            elif key in sections[section.tag]:
                first = sections[section.tag][key].line
                problems.add(location, f"duplicate key {key!r} (first in line {first}); keep one")
            else:
                sections[section.tag][key] = element
    return sections


def _locate(path: Path, key: str, element: Element) -> Location:
    return Location(path, element.line, f"<{element.tag}>: {key}")


def _value(path: Path, key: str, element: Element, problems: Problems) -> int | float | bool | str | None:
    text = element.attributes["value"].strip()
    kind = element.attributes.get("type", "STRING").strip().upper()
    location = _locate(path, key, element)
    if kind in {"INT", "LONG"}:
        return parse_integer(text, location, problems)
    if kind in {"FLOAT", "DOUBLE"}:
        return parse_number(text, location, problems)
    if kind == "BOOLEAN":
        if text.lower() in {"true", "false"}:
            return text.lower() == "true"
        problems.add(location, f"{text!r} found, expected true or false")
        return None
    if kind not in _TYPES:
        problems.add(location, f"unknown type {kind!r}; expected {', '.join(_TYPES)}")
        return None
    return text


def _count(path: Path, entries: dict[str, Element], key: str, problems: Problems) -> int | None:
    if key not in entries:
        return None
    element = entries[key]
    text = element.attributes["value"].strip()
    if text.lower() in {"", "null"} and key.endswith("Candidates"):
        return None  # Modelio writes null for missing values
    location = _locate(path, key, element)
    count = parse_integer(text, location, problems)
    if count is not None and count < 1:
        problems.add(location, f"{count} found, expected a whole number of at least 1")
        return None
    return count
