"""Write the values of a candidate back into the files of its model."""

import json
import re
from collections.abc import Callable, Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, unescape

from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes
from swarmwright.common.suggestions import alike
from swarmwright.controllers import scxml
from swarmwright.export.exporting import write
from swarmwright.export.scxml import Scxml
from swarmwright.export.subject import Subject, load_subject
from swarmwright.interop.models import json_source, sysml
from swarmwright.interop.models._files import list_files
from swarmwright.interop.models._files import load as load_part
from swarmwright.interop.models._parts import OptimisedParameter, Part, SimulationParameters
from swarmwright.runs.run import Run, open_run

CANDIDATE = "candidate.json"
"""Values in the format in which CPSwarm's optimization tool passes a candidate to simulators and robots."""
_LARGEST_FILE_BYTES = 1 << 28
_COMMENT = re.compile(r"<!--.*?-->|<!\[CDATA\[.*?\]\]>", re.DOTALL)
_TAG = re.compile(r"<(?:[\w.-]+:)?(SwarmMember|swarmMember|propentry)\b(?:[^>\"']|\"[^\"]*\"|'[^']*')*>")

_STARTS = {
    b"\xef\xbb\xbf": "utf-8",
    b"\xff\xfe": "utf-16-le",
    b"\xfe\xff": "utf-16-be",
    b"<\0": "utf-16-le",
    b"\0<": "utf-16-be",
}
_DECLARED = re.compile(rb"<\?xml[^>]*?\sencoding\s*=\s*[\"']([A-Za-z][\w.-]*)")

Values = dict[str, Any]
"""Parameters of the simulation by name."""
Counts = dict[str, str | None]
"""Kind of agents -> parameter with their number; None if there is none."""


def write_back(
    run: Run | str | PathLike[str],
    paths: Iterable[str | PathLike[str]],
    *,
    output: str | PathLike[str],
    generation: int | None = None,
    candidate: int | None = None,
    force: bool = False,
) -> tuple[Subject, list[Path]]:
    """Write copies of a model's files with the values of a candidate; return it and the paths.

    Args:
        run: a run, or its folder.
        paths: the files of the model, or folders with them.
        output: the folder to write to.
        generation: generation of the candidate, from 0; as in `Run.evaluation`.
        candidate: as in `Run.evaluation`; default: the best.
        force: overwrite existing files.

    Raises:
        InputError: the candidate does not exist, a file is invalid, or nothing in the files was evolved.
    """
    opened = open_run(run)
    subject = load_subject(opened, generation, candidate)
    simulation = SimulationParameters(opened.experiment.simulation)
    parts = [load_part(path) for path in list_files(map(Path, paths))]
    values = dict(subject.values)
    files: dict[str, str | bytes] = {}
    counts = _counts(parts, simulation)
    for part in parts:
        content = _update_file(part, subject, values, simulation, counts)
        if content is not None:
            if part.path.name in files:
                raise InputError(f"{part.path}: another file has the same name; rename one of the files")
            files[part.path.name] = content
    optimised = [parameter for part in parts for parameter in part.optimised]
    entries = [
        {
            "name": parameter.name,
            "meta": parameter.meta,
            "value": _value(values, simulation, parameter.name, counts),
        }
        for parameter in optimised
        if _value(values, simulation, parameter.name, counts) is not None
    ]
    if entries:
        files[CANDIDATE] = json.dumps(entries, indent=2) + "\n"
    if not files:
        evolved = f"the parameters {', '.join(values)}" if values else f"a controller, {subject.kind}"
        raise InputError(
            f"{', '.join(str(part.path) for part in parts)}: the run evolved nothing in these files; it "
            f"evolved {evolved}"
        )
    return subject, write(files, Path(output), force=force)


def _counts(parts: list[Part], simulation: SimulationParameters) -> Counts:
    """Return the parameters with the numbers of agents, as `Parameters` takes them."""
    members = [member.name for part in parts for member in part.members]
    if len(members) == 1:
        return {members[0]: simulation.agents}
    return (
        {name: simulation.find_agents_of(name) for name in members}
        if any(part.has_groups for part in parts)
        else {}
    )


def _value(values: Values, simulation: SimulationParameters, name: str, counts: Counts) -> Any:  # noqa: ANN401 - a number or text
    """Return the value of a parameter, or the number of members; None if it was not evolved."""
    kinds = list(counts)
    parameters = [counts[kinds[index]] for index in alike(name, kinds)]
    parameter = next(filter(None, parameters), None) or simulation.find(name)
    return values.get(parameter) if parameter is not None else None


def _update_file(
    part: Part, subject: Subject, values: Values, simulation: SimulationParameters, counts: Counts
) -> str | bytes | None:
    """Return a file with the values; None if nothing in it was evolved."""
    if part.behaviour is not None:
        return _update_machine(part.behaviour, subject) if subject.kind == "mealy_fsm" else None

    def value(name: str) -> Any:  # noqa: ANN401 - a number or text
        return _value(values, simulation, name, counts)

    if part.kind == sysml.WORDS:
        return sysml.with_values(part.path, value)
    if part.optimised:
        return _update_optimised(part, value)
    names = [*(member.name for member in part.members), *(property_.name for property_ in part.properties)]
    if any(value(name) is not None for name in names):
        return _update_tags(part.path, value)
    return None


def _update_machine(machine: scxml.StateMachine, subject: Subject) -> str | bytes:
    (text,) = Scxml().files(subject, machine.path.stem).values()
    return text


def _update_optimised(part: Part, value: Callable[[str], Any]) -> str | None:
    """Return OptimisedParameters with a `value` between min and max for each parameter."""
    document: Any = json_source.read(part.path).values
    by_name: Mapping[str, OptimisedParameter] = {parameter.name: parameter for parameter in part.optimised}
    changed = False
    for entry in document["parameters"]:
        target = by_name[entry["name"].strip()]
        number = value(target.name)
        if number is not None:
            exact = target.whole and number % target.scale == 0
            entry["value"] = int(number // target.scale) if exact else float(f"{number / target.scale:.9g}")
            changed = True
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n" if changed else None


def _update_tags(path: Path, value: Callable[[str], Any]) -> bytes:
    """Return XML with updated attributes; everything else is kept, including the encoding."""
    data = read_bytes(path, _LARGEST_FILE_BYTES)
    encoding = _encoding(data)
    try:
        text = data.decode(encoding)
    except (LookupError, UnicodeDecodeError):
        raise InputError(f"{path}: is not valid in its encoding, {encoding}") from None
    hidden = [match.span() for match in _COMMENT.finditer(text)]

    def replace(match: re.Match[str]) -> str:
        if any(begin <= match.start() < end for begin, end in hidden):
            return match[0]
        naming, set_ = ("key", "value") if match[1] == "propentry" else ("name", "number")
        name = _attribute(match[0], naming)
        tags = None if name is None else value(name.strip())
        return match[0] if tags is None else _set_attribute(match[0], set_, str(tags))

    # Characters outside the encoding become numeric references.
    return _TAG.sub(replace, text).encode(encoding, "xmlcharrefreplace")


def _encoding(data: bytes) -> str:
    """Return the encoding of XML by its first bytes or its declaration.

    A byte order mark is decoded as a character and stays in the text.
    """
    for start, encoding in _STARTS.items():
        if data.startswith(start):
            return encoding
    declared = _DECLARED.match(data)
    return "utf-8" if declared is None else declared[1].decode("ascii")


def _pattern(name: str) -> re.Pattern[str]:
    return re.compile(rf"(\s{name}\s*=\s*)(\"[^\"]*\"|'[^']*')")


def _attribute(tag: str, name: str) -> str | None:
    match = _pattern(name).search(tag)
    return None if match is None else unescape(match[2][1:-1], {"&quot;": '"', "&apos;": "'"})


def _set_attribute(tag: str, name: str, text: str) -> str:
    """Return a tag with an attribute changed or added."""
    written = f'"{escape(text, {chr(34): "&quot;"})}"'
    changed, count = _pattern(name).subn(lambda match: match[1] + written, tag, count=1)
    return changed if count else re.sub(r"\s*(/?>)$", rf" {name}={written}\1", tag)
