"""The code of behaviours and conditions in Python, by which servers that have it are found."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName, is_in_file
from swarmwright.controllers.modules import Condition, grammar
from swarmwright.controllers.modules.grammar import PYTHON_KIND, Catalogue, Module
from swarmwright.controllers.modules.registered import REGISTRIES, module, name_of
from swarmwright.simulations.loading import import_with_digest
from swarmwright.simulations.user_code import trust
from swarmwright.simulations.user_code.parts import format_part_name, read_plug_in

ROLES = {"behaviour": "behaviours", "condition": "conditions"}
"""What a module is -> the key of specifications that lists such modules."""


def is_in_python(architecture: Mapping[str, Any]) -> bool:
    """Whether controllers are machines with modules in Python."""
    return architecture.get("kind") == PYTHON_KIND


def sha256_of(role: str, known: Module) -> str | None:
    """Return the SHA-256 of a module's code; None where an installed one has no source to look at."""
    return known.sha256 if known.file else _sha256_of_installed(role, known.name)


@cache
def _sha256_of_installed(role: str, name: str) -> str | None:
    part = read_plug_in(format_part_name(role, name), name)
    return None if part is None else trust.digest_of(part.digests)


def with_digests(architecture: Mapping[str, Any]) -> dict[str, Any]:
    """Return a specification with the SHA-256 of the code of installed modules as well.

    Controllers know it of modules in files only; servers must have the code that is here. Raises InputError
    for modules that are not installed.
    """
    if not is_in_python(architecture):
        return dict(architecture)
    found = dict(architecture)
    for role, key in ROLES.items():
        entries = []
        for entry in architecture[key]:
            known = grammar.module_of(entry)
            sha256 = None if known.built_in else sha256_of(role, known)
            entries.append(dict(entry) if sha256 is None else {**entry, "sha256": sha256})
        found[key] = entries
    return found


def in_python(architecture: Mapping[str, Any]) -> Iterator[tuple[str, Module]]:
    """Yield the modules in Python of a specification: behaviour or condition, and module."""
    catalogue = Catalogue.of(architecture)
    for role, parts in (("behaviour", catalogue.behaviours), ("condition", catalogue.conditions)):
        yield from ((role, part) for part in parts if not part.built_in)


def names_of(architectures: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return how servers are told which modules machines need: file:Class, or the name of an installed one.

    Raises InputError for modules that are not here.
    """
    names = [name_of(*key) for architecture in architectures for key in in_python(architecture)]
    return list(dict.fromkeys(names))


def offered(names: Sequence[str]) -> dict[tuple[str, str], list[Module]]:
    """Import modules by their names.

    names: file:Class, or that of an installed module, or of both a behaviour and a condition.

    Returns:
        What there is by role and name; of a name in two files two.

    Raises InputError for names of nothing, and for modules that are not right.
    """
    found: dict[tuple[str, str], list[Module]] = {}
    for name in names:
        if is_in_file(name):
            roles = [_role_in_file(name)]
        else:
            roles = [role for role in ROLES if name in REGISTRIES[role].names()]
            if not roles:
                known = sorted(
                    {kind for role in ROLES for kind in REGISTRIES[role].names() if not _is_built_in(kind)}
                )
                there = f"installed are {', '.join(known)}" if known else "none is installed"
                raise InputError(
                    f"modules: {name!r} is unknown; {there}; one in a file is named like file.py:Class"
                )
        for role in roles:
            module_of_role = module(role, name)
            if module_of_role.built_in:
                raise InputError(f"modules: {name!r} is one of the engine's, which every server has")
            found.setdefault((role, module_of_role.name), []).append(module_of_role)
    return found


def _is_built_in(name: str) -> bool:
    return name in grammar.BEHAVIOURS or name in grammar.CONDITIONS


def _role_in_file(name: str) -> str:
    """Return what the class in a file is; behaviour for what is neither, for the message of that."""
    parsed = SimulationName.parse(name)
    assert parsed.file is not None
    kind = getattr(import_with_digest(parsed.file)[0], parsed.member, None)
    return "condition" if isinstance(kind, type) and issubclass(kind, Condition) else "behaviour"
