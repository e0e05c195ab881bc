"""Code of behaviours and conditions in Python, by whose digest servers are matched."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName, is_in_file
from swarmwright.controllers.modules import Condition, grammar
from swarmwright.controllers.modules.grammar import PYTHON_KIND, Catalogue, Module
from swarmwright.controllers.modules.registered import REGISTRIES, import_name_of, module
from swarmwright.simulations.loading import import_with_digest
from swarmwright.simulations.user_code import trust
from swarmwright.simulations.user_code.parts import format_part_name, read_plug_in

ROLES = {"behaviour": "behaviours", "condition": "conditions"}
"""Role of a module -> the key of specifications that lists the modules of this role."""


def is_in_python(architecture: Mapping[str, Any]) -> bool:
    """Whether controllers are machines with modules in Python."""
    return architecture.get("kind") == PYTHON_KIND


def sha256_of(role: str, definition: Module) -> str | None:
    """Return the SHA-256 of a module's code; None for an installed module without source."""
    return definition.sha256 if definition.file else _sha256_of_installed(role, definition.name)


@cache
def _sha256_of_installed(role: str, name: str) -> str | None:
    part = read_plug_in(format_part_name(role, name), name)
    return None if part is None else trust.digest_of(part.digests)


def with_digests(architecture: Mapping[str, Any]) -> dict[str, Any]:
    """Add the SHA-256 of installed modules to a specification, which has only those of modules in files.

    Servers must have the same code. Raises InputError for modules that are not installed.
    """
    if not is_in_python(architecture):
        return dict(architecture)
    specification = dict(architecture)
    for role, key in ROLES.items():
        entries = []
        for entry in architecture[key]:
            definition = grammar.parse_module(entry)
            sha256 = None if definition.built_in else sha256_of(role, definition)
            entries.append(dict(entry) if sha256 is None else {**entry, "sha256": sha256})
        specification[key] = entries
    return specification


def iter_python_modules(architecture: Mapping[str, Any]) -> Iterator[tuple[str, Module]]:
    """Yield the role and definition of each Python module of a specification."""
    catalogue = Catalogue.from_specification(architecture)
    for role, parts in (("behaviour", catalogue.behaviours), ("condition", catalogue.conditions)):
        yield from ((role, part) for part in parts if not part.built_in)


def names_of(architectures: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the names of the modules that machines need: file:Class, or the name of an installed module.

    Raises InputError for modules that are not available.
    """
    names = [
        import_name_of(*key) for architecture in architectures for key in iter_python_modules(architecture)
    ]
    return list(dict.fromkeys(names))


def import_modules(names: Sequence[str]) -> dict[tuple[str, str], list[Module]]:
    """Import modules by their names.

    names: file:Class, or the name of an installed behaviour, condition or both.

    Returns:
        The modules by role and name; several if files share a name.

    Raises InputError for unknown names and invalid modules.
    """
    modules: dict[tuple[str, str], list[Module]] = {}
    for name in names:
        if is_in_file(name):
            roles = [_role_in_file(name)]
        else:
            roles = [role for role in ROLES if name in REGISTRIES[role].names()]
            if not roles:
                installed = sorted(
                    {kind for role in ROLES for kind in REGISTRIES[role].names() if not _is_built_in(kind)}
                )
                hint = f"installed: {', '.join(installed)}" if installed else "no module is installed"
                raise InputError(
                    f"modules: {name!r} is unknown ({hint}); for a module in a file, write file.py:Class"
                )
        for role in roles:
            module_of_role = module(role, name)
            if module_of_role.built_in:
                raise InputError(f"modules: {name!r} is built in; every server has it")
            modules.setdefault((role, module_of_role.name), []).append(module_of_role)
    return modules


def _is_built_in(name: str) -> bool:
    return name in grammar.BEHAVIOURS or name in grammar.CONDITIONS


def _role_in_file(name: str) -> str:
    """Return the role of a class in a file; behaviour for other classes, whose check then fails."""
    parsed = SimulationName.parse(name)
    assert parsed.file is not None
    kind = getattr(import_with_digest(parsed.file)[0], parsed.member, None)
    return "condition" if isinstance(kind, type) and issubclass(kind, Condition) else "behaviour"
