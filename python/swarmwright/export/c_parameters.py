"""Parameter sets in C and C++: a constant with a member for each parameter."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from swarmwright.controllers.source.text import identifiers, is_reserved, literals, plain
from swarmwright.export._base import Files, facts, render
from swarmwright.export.subject import Subject

_BITS = """static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}"""


def files(subject: Subject, prefix: str, *, cpp: bool = False) -> Files:
    """Return header, source (for C) and self-test."""
    values = {
        "p": prefix,
        "PREFIX": prefix.upper(),
        "facts": facts(subject),
        "header": f"{prefix}.hpp" if cpp else f"{prefix}.h",
        "ending": "cpp" if cpp else "c",
        "type": f"const {prefix}::Parameters set = {prefix}::parameters();"
        if cpp
        else f"const {prefix}_t set = {prefix};",
        "bits": _BITS if any(isinstance(value, float) for value in subject.values.values()) else "",
        "members": "\n".join(_declared(subject)),
        "values": ",\n".join(f"        {_literal(value)}" for value in subject.values.values()),
        "checks": "\n".join(_checks(subject.values)),
    }
    made: Files = {f"{prefix}_test.{values['ending']}": render("c_parameters_test.txt", values)}
    if cpp:
        return {f"{prefix}.hpp": render("cpp_parameters.txt", values), **made}
    return {
        f"{prefix}.h": render("c_parameters_header.txt", values),
        f"{prefix}.c": render("c_parameters_source.txt", values),
        **made,
    }


def members(values: Mapping[str, Any]) -> list[str]:
    """Return the name of the member for each parameter."""
    names = (name.lower() for name in identifiers(values, "PARAMETER"))
    return [f"{name}_" if is_reserved(name) else f"p{name}" if name[0].isdigit() else name for name in names]


def _declared(subject: Subject) -> Iterator[str]:
    for member, (name, value) in zip(members(subject.values), subject.values.items(), strict=True):
        kind = (
            "const char *" if isinstance(value, str) else "int32_t " if isinstance(value, int) else "float "
        )
        limits = f", {subject.ranges[name]}" if name in subject.ranges else ""
        yield f"    {kind}{member}; /* {plain(name)}{plain(limits)} */"


def _literal(value: object) -> str:
    if isinstance(value, str):
        return f'"{"".join(map(_escaped, value.encode()))}"'
    return str(value) if isinstance(value, int) else literals(np.array([value], np.float32))[0]


def _escaped(byte: int) -> str:
    """Return a byte as it is in a string of C; octal numbers end after three digits."""
    as_it_is = chr(byte).isalnum() or chr(byte) in " _-+.,:;()[]{}=<>!*#%&|~^/"
    return chr(byte) if byte < 128 and as_it_is else f"\\{byte:03o}"


def _checks(values: Mapping[str, Any]) -> Iterator[str]:
    """Yield a comparison for each parameter: of text, of numbers, of bits."""
    for member, (name, value) in zip(members(values), values.items(), strict=True):
        if isinstance(value, str):
            wrong = f"strcmp(set.{member}, {_literal(value)}) != 0"
        elif isinstance(value, int):
            wrong = f"set.{member} != {value}"
        else:
            bits = np.array([value], np.float32).view(np.uint32)[0]
            wrong = f"bits_of(set.{member}) != 0x{bits:08x}u"
        yield f'    if ({wrong}) {{\n        puts("{plain(name)} is wrong");\n        return 1;\n    }}'
