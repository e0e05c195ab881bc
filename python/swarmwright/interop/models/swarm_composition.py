"""SwarmComposition: the kinds of agents of a swarm and their numbers, in XML.

`<Swarm name=".."><SwarmMember name=".." launchFile=".." number=".."/></Swarm>`, as written by Modelio's
CPSwarm module and read by the launcher of the CPSwarm workbench.
"""

from pathlib import Path

from swarmwright.common.xml import read
from swarmwright.interop.models._parts import Location, Member, Part, Problems, parse_integer

ROOTS = ("swarm", "SwarmComposition", "Swarm")
WORDS = "a SwarmComposition (<Swarm> with <SwarmMember>)"
_MEMBERS = ("SwarmMember", "swarmMember")


def load(path: Path) -> Part:
    """Read a composition. Raises InputError with all problems, each with file and line."""
    root = read(path)
    problems = Problems()
    part = Part(path, WORDS, name=root.attributes.get("name", "").strip())
    first: dict[str, int] = {}
    for element in root.children:
        location = Location(path, element.line, f"<{element.tag}>")
        if element.tag.rpartition(":")[2] not in _MEMBERS:
            problems.add(location, f"found inside <{root.tag}>; expected <SwarmMember>")
            continue
        for attribute in element.attributes:
            if attribute not in {"name", "launchFile", "number"} and ":" not in attribute:
                problems.add(location, f"unknown attribute {attribute}; expected name, launchFile, number")
        if "launchFile" not in element.attributes:
            problems.add(location, "the attribute launchFile is missing")
        number = parse_integer(element.attributes.get("number", "1").strip(), location, problems)
        if number is not None and not 0 <= number <= 1_000_000:
            problems.add(location, f"number is {number}, expected 0 to 1000000")
        launch_file = element.attributes.get("launchFile", "").strip()
        name = element.attributes.get("name", "").strip() or Path(launch_file).stem
        if not name:
            problems.add(location, "the attribute name is missing")
        elif name in first:
            problems.add(location, f"duplicate name {name!r} (first in line {first[name]}); keep one")
        first.setdefault(name, element.line)
        part.members.append(Member(name, launch_file, number or 0, location))
    problems.stop()
    if sum(member.number for member in part.members) < 1:
        raise root.error("has no agents; expected a <SwarmMember> with a number of at least 1")
    return part
