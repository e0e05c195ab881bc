"""Kinds of model files, recognised by their content; each kind is a module listed here."""

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
"""Modules with `ROOTS` (names of root elements), `WORDS` and `load(path)`."""
_JSON: tuple[Any, ...] = (optimised_parameters, abstractions)
"""Modules with `recognises(values)`, `WORDS` and `load(path, source)`."""
_SESSION = "frevo"
_SUFFIXES = frozenset({".json", ".scxml", ".sysml", ".xml"})
"""Suffixes of the files of a folder that are read."""


def load(path: Path) -> Part:
    """Read a file of a known kind.

    Raises InputError for a file of an unknown kind, or with all problems in it, each with file and line.
    """
    if path.suffix.lower() == ".onnx":
        raise InputError(f"{path}: ONNX models cannot be converted to controllers; {_describe_expected()}")
    simulator_hint = simulator_file(path.name)
    if simulator_hint is not None:
        raise InputError(f"{path}: {simulator_hint}")
    first = first_character(path)
    if first == "<":
        return _load_xml(path)
    if is_utf16(read_contents(path)):
        raise InputError(f"{path}: {IS_UTF16}")
    if first in {"{", "["}:
        return _load_json(path)
    if first and sysml.recognises(path, read_text(path)):
        return sysml.load(path)
    raise InputError(f"{path}: {'is empty' if not first else 'unknown kind of file'}; {_describe_expected()}")


def list_files(paths: Iterable[Path]) -> list[Path]:
    """Return the files, and those of folders by name. Raises InputError for a folder without model files."""
    files: list[Path] = []
    for path in paths:
        if not path.is_dir():
            files.append(path)
            continue
        inside = sorted(neighbour for neighbour in path.iterdir() if _is_model(neighbour))
        if not inside:
            raise InputError(f"{path}: contains no file with the suffix {', '.join(sorted(_SUFFIXES))}")
        files += inside
    return files


def _is_model(path: Path) -> bool:
    """Whether a file of a folder is a model, and not written by Swarmwright."""
    written = path.name == "candidate.json" or path.name.endswith(".controller.json")
    return path.suffix.lower() in _SUFFIXES and path.is_file() and not written


def _load_xml(path: Path) -> Part:
    root = xml.root_of(path)
    tag = root.tag.rpartition(":")[2]
    if tag == _SESSION:
        raise InputError(f"{path}: is a FREVO session; import it without other files")
    for module in _XML:
        if tag in module.ROOTS:
            part: Part = module.load(path)
            return part
    roots = [name for module in _XML for name in module.ROOTS]
    raise root.error(f"unknown root element{did_you_mean(tag, roots)}; {_describe_expected()}")


def _load_json(path: Path) -> Part:
    source = json_source.read(path)
    for module in _JSON:
        if module.recognises(source.values):
            if source.problems:
                raise InputError(
                    "\n".join(f"{source.locate(at)}{problem}" for at, _, problem in source.problems)
                )
            part: Part = module.load(path, source)
            return part
    raise InputError(f"{path}: unknown kind of JSON file; {_describe_expected()}")


def _describe_expected() -> str:
    words = [module.WORDS for module in (*_XML, *_JSON, sysml)]
    return f"expected a FREVO session (<{_SESSION}>), {', '.join(words[:-1])} or {words[-1]}"
