"""Kinds of files, recognised by what they hold: one module for each, and its line here."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from swarmwright.common import xml
from swarmwright.common.errors import InputError
from swarmwright.common.files import IS_UTF16, first_character, is_utf16, read_contents
from swarmwright.common.simulation_names import simulator_file
from swarmwright.common.suggestions import did_you_mean
from swarmwright.interop.models import (
    abstractions,
    behaviour,
    frevo_problem,
    json_source,
    optimised_parameters,
    swarm_composition,
    sysml,
)
from swarmwright.interop.models._parts import Part
from swarmwright.interop.models._sysml_text import read_text

_XML: tuple[Any, ...] = (frevo_problem, swarm_composition, behaviour)
"""Modules with `ROOTS`, names of root elements, `WORDS` and `load(path)`."""
_JSON: tuple[Any, ...] = (optimised_parameters, abstractions)
"""Modules with `recognises(values)`, `WORDS` and `load(path, source)`."""
_SESSION = "frevo"
_SUFFIXES = frozenset({".json", ".scxml", ".sysml", ".xml"})
"""Files of a folder that are looked at."""


def load(path: Path) -> Part:
    """Read a file of a kind that is known.

    Raises InputError when it is of no known kind, or with everything that is wrong in it, file and line each.
    """
    if path.suffix.lower() == ".onnx":
        raise InputError(f"{path}: is an ONNX model, from which no controller can be made; {_expected()}")
    of_a_simulator = simulator_file(path.name)
    if of_a_simulator is not None:
        raise InputError(f"{path}: {of_a_simulator}")
    first = first_character(path)
    if first == "<":
        return _load_xml(path)
    if is_utf16(read_contents(path)):
        raise InputError(f"{path}: {IS_UTF16}")
    if first in {"{", "["}:
        return _load_json(path)
    if first and sysml.recognises(path, read_text(path)):
        return sysml.load(path)
    raise InputError(f"{path}: {'is empty' if not first else 'is of no kind that is known'}; {_expected()}")


def files_of(paths: Iterable[Path]) -> list[Path]:
    """Return the files themselves, and those of folders by name. Raises InputError for an empty folder."""
    files: list[Path] = []
    for path in paths:
        if not path.is_dir():
            files.append(path)
            continue
        inside = sorted(neighbour for neighbour in path.iterdir() if _is_model(neighbour))
        if not inside:
            raise InputError(f"{path}: no file with the ending {', '.join(sorted(_SUFFIXES))} is in it")
        files += inside
    return files


def _is_model(path: Path) -> bool:
    """Whether a file of a folder is looked at, which those that Swarmwright has written beside it are not."""
    written = path.name == "candidate.json" or path.name.endswith(".controller.json")
    return path.suffix.lower() in _SUFFIXES and path.is_file() and not written


def _load_xml(path: Path) -> Part:
    root = xml.root_of(path)
    tag = root.tag.rpartition(":")[2]
    if tag == _SESSION:
        raise InputError(f"{path}: is a FREVO session, which is imported alone, without other files")
    for module in _XML:
        if tag in module.ROOTS:
            part: Part = module.load(path)
            return part
    known = [name for module in _XML for name in module.ROOTS]
    raise root.error(f"found as the outermost element{did_you_mean(tag, known)}; {_expected()}")


def _load_json(path: Path) -> Part:
    source = json_source.read(path)
    for module in _JSON:
        if module.recognises(source.values):
            if source.problems:
                raise InputError("\n".join(f"{source.place(at)}{what}" for at, _, what in source.problems))
            part: Part = module.load(path, source)
            return part
    raise InputError(f"{path}: is JSON of no kind that is known; {_expected()}")


def _expected() -> str:
    words = [module.WORDS for module in (*_XML, *_JSON, sysml)]
    return f"expected a FREVO session (<{_SESSION}>), {', '.join(words[:-1])} or {words[-1]}"
