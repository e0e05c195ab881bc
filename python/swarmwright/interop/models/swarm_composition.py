"""SwarmComposition: the kinds of agents of a swarm and how many there are of each, in XML.

`<Swarm name=".."><SwarmMember name=".." launchFile=".." number=".."/></Swarm>`, as Modelio's CPSwarm module
writes it and the launcher of the CPSwarm workbench reads it.
"""

from pathlib import Path

from swarmwright.common.xml import read
from swarmwright.interop.models._names import whole_of
from swarmwright.interop.models._parts import Member, Part, Place, Problems

ROOTS = ("swarm", "SwarmComposition", "Swarm")
WORDS = "a SwarmComposition (<Swarm> with <SwarmMember>)"
_MEMBERS = ("SwarmMember", "swarmMember")


def load(path: Path) -> Part:
    """Read a composition. Raises InputError with everything that is wrong, file and line each."""
    root = read(path)
    problems = Problems()
    part = Part(path, WORDS, name=root.attributes.get("name", "").strip())
    first: dict[str, int] = {}
    for element in root.children:
        place = Place(path, element.line, f"<{element.tag}>")
        if element.tag.rpartition(":")[2] not in _MEMBERS:
            problems.add(place, f"found inside <{root.tag}>; expected <SwarmMember>")
            continue
        for attribute in element.attributes:
            if attribute not in {"name", "launchFile", "number"} and ":" not in attribute:
                problems.add(place, f"unknown attribute {attribute}; expected name, launchFile, number")
        if "launchFile" not in element.attributes:
            problems.add(place, "the attribute launchFile is missing")
        number = whole_of(element.attributes.get("number", "1").strip(), place, problems)
        if number is not None and not 0 <= number <= 1_000_000:
            problems.add(place, f"number is {number}, expected 0 to 1000000")
        launch_file = element.attributes.get("launchFile", "").strip()
        name = element.attributes.get("name", "").strip() or Path(launch_file).stem
        if not name:
            problems.add(place, "the attribute name is missing")
        elif name in first:
            problems.add(place, f"duplicate name {name!r} (first in line {first[name]}); keep one")
        first.setdefault(name, element.line)
        part.members.append(Member(name, launch_file, number or 0, place))
    problems.stop()
    if sum(member.number for member in part.members) < 1:
        raise root.error("has no agents; expected a <SwarmMember> with a number of at least 1")
    return part
