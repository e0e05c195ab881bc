"""`swarmwright.h` declares `engine/bindings/c`: the same functions, structures and constants, with types."""

import re
from pathlib import Path

from tests.conftest import ROOT

CRATE = ROOT / "engine" / "bindings" / "c"
HEADER = CRATE / "include" / "swarmwright" / "swarmwright.h"
SCALARS = {
    "c_char": "char",
    "c_void": "void",
    "i32": "int32_t",
    "i64": "int64_t",
    "u32": "uint32_t",
    "u64": "uint64_t",
    "usize": "size_t",
    "f32": "float",
    "f64": "double",
    "bool": "bool",
}
OBJECTS = {
    "RawOptions": "swarmwright_options",
    "RawDescription": "swarmwright_description",
    "RawMetric": "swarmwright_metric",
    "RawSimulation": "swarmwright_simulation",
    "RawEvent": "swarmwright_event",
    "ParameterHandle": "swarmwright_parameters",
    "Server": "swarmwright_server",
    "Plugin": "swarmwright_plugin",
    "RawBody": "swarmwright_body",
    "Picture": "swarmwright_scene",
    "RawPhysics": "swarmwright_physics",
    "RawStart": "swarmwright_start",
    "RawWorld": "swarmwright_world",
    "RawPolygon": "swarmwright_polygon",
    "RawRobot": "swarmwright_robot",
    "RawObject": "swarmwright_object",
    "WorldLight": "swarmwright_light",
    "Pose": "swarmwright_pose",
    "Motion": "swarmwright_motion",
}


def _split(text: str) -> list[str]:
    """At the commas that stand in no brackets."""
    parts, depth, start = [], 0, 0
    for index, letter in enumerate(text):
        depth += letter in "(<["
        depth -= letter in ")>]"
        if letter == "," and depth == 0:
            parts.append(text[start:index])
            start = index + 1
    return [part.strip() for part in [*parts, text[start:]] if part.strip()]


def _without_comments(text: str) -> str:
    return re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL)


def _rust() -> str:
    """All sources, without tests, comments and line ends."""
    folders = [CRATE / "src", ROOT / "engine" / "worlds" / "arena" / "src" / "physics"]
    sources = [path for one in folders for path in sorted(one.rglob("*.rs")) if path.name != "tests.rs"]
    text = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    return re.sub(r"\s+", " ", re.sub(r"//.*", "", text))


ALIASES = dict(re.findall(r"type (\w+) = (unsafe extern \"C\" fn\(.*?\)(?: -> \w+)?);", _rust()))
"""Types of functions, by their names."""


def _c_type(rust: str) -> str:
    """How C spells a Rust type, with `const` behind what it is about: `*const f32` is `float const*`."""
    rust = re.sub(r"<'\w+>", "", rust.strip())
    if option := re.fullmatch(r"Option<(\w+)>", rust):
        return _c_function(ALIASES[option[1]])
    if pointer := re.fullmatch(r"\*(const|mut) (.*)", rust):
        return _c_type(pointer[2]) + (" const*" if pointer[1] == "const" else "*")
    return SCALARS.get(rust) or OBJECTS[rust]


def _c_function(rust: str) -> str:
    """A Rust function's type as `result(argument, ..)`."""
    match = re.search(r"fn ?\w*\((.*)\)(?: -> (.*?))?$", rust)
    assert match, rust
    arguments = [argument.rpartition(": ")[2] for argument in _split(match[1])]
    return f"{_c_type(match[2]) if match[2] else 'void'}({', '.join(map(_c_type, arguments))})"


def _plain(c: str) -> str:
    """A C type without the name behind it, spaces as above."""
    c = c.replace("swarmwright_status", "int32_t")
    function = re.fullmatch(r"(.*?)\(\*\w+\)\((.*)\)", c.strip())
    if function:
        return f"{_plain(function[1] + ' x')}({', '.join(map(_plain, _split(function[2])))})"
    c = re.sub(r"\b\w+$", "", c.strip()).strip()
    c = re.sub(r"^const (\w+)", r"\1 const", c)
    return re.sub(r"\*\s*", "*", re.sub(r"\s*\*", "*", c)).replace("*const", "* const")


def _functions_of_header() -> dict[str, str]:
    lines = _without_comments(HEADER.read_text(encoding="utf-8")).splitlines()
    text = re.sub(r"\s+", " ", " ".join(line for line in lines if not line.startswith("#")))
    found = re.findall(r"([\w ]+?[ *]+)(swarmwright_\w+)\(([^()]*)\) SWARMWRIGHT_NOEXCEPT;", text)
    functions = {}
    for result, name, arguments in found:
        types = [] if arguments == "void" else map(_plain, _split(arguments))
        functions[name] = f"{_plain(result + 'x')}({', '.join(types)})"
    return functions


def test_every_function_is_declared_as_it_is() -> None:
    pattern = r"#\[unsafe\(no_mangle\)\] pub (?:unsafe )?extern \"C\" fn (\w+)\((.*?)\)(?: -> ([^{]*?))? \{"
    rust = {
        name: _c_function(f"fn({arguments})" + (f" -> {result}" if result else ""))
        for name, arguments, result in re.findall(pattern, _rust())
    }
    assert len(rust) > 30
    assert _functions_of_header() == rust


def test_every_structure_has_the_fields_that_it_has() -> None:
    header = _without_comments(HEADER.read_text(encoding="utf-8"))
    c = {
        name: [
            (re.findall(r"\w+", re.sub(r"\(\*(\w+)\).*", r"\1", field))[-1], _plain(field))
            for field in map(str.strip, re.sub(r"\s+", " ", body).split(";"))
            if field
        ]
        for name, body in re.findall(r"typedef struct (\w+) \{(.*?)\} \w+;", header, re.DOTALL)
    }
    rust = {
        OBJECTS[name]: [
            (field.partition(": ")[0].removeprefix("pub "), _c_type(field.partition(": ")[2]))
            for field in _split(body)
        ]
        for name, body in re.findall(
            r"#\[repr\(C\)\] (?:#\[derive\(Clone, Copy\)\] )?(?:pub )?struct (\w+) \{(.*?)\}", _rust()
        )
    }
    assert len(rust) == 15
    assert c == rust


def test_constants_agree() -> None:
    header = HEADER.read_text(encoding="utf-8")
    constants = dict(re.findall(r"#define SWARMWRIGHT_(\w+) (\d+)$", header, re.MULTILINE))
    source = _rust()
    assert f"pub const ABI: u32 = {constants['ABI']};" in source
    for name in ("OK", "INVALID", "FAILED"):
        assert f"const {name}: i32 = {constants[name]};" in source
    for name, kind in (
        ("READY", "Ready"),
        ("BUSY", "Busy(_)"),
        ("WARNING", "Warning(_)"),
        ("LOST", "Lost(_)"),
    ):
        assert f"Notice::{kind} => {constants[f'NOTICE_{name}']}," in source
    for name in ("UNDECLARED", "BITWISE", "NONE"):
        assert f"{constants[name]} => Determinism::{name.capitalize()}," in source
    assert f"{constants['STATISTICAL']} if tolerance" in source
    for name, event in (("RESET", "Request::Reset"), ("STEP", "Request::Step")):
        behind = source.split(f"News::Asked({event}(", 1)[1]
        assert re.search(r"event\.kind = (\d)", behind)[1] == constants[name]  # type: ignore[index]
    assert f"News::Abandoned => event.kind = {constants['ABANDONED']}" in source
    assert f"libswarmwright.so.{constants['ABI']}" in (CRATE / "build.rs").read_text(encoding="utf-8")
    cmake = Path(ROOT / "wrappers/cpp/CMakeLists.txt").read_text(encoding="utf-8")
    assert f"set(SWARMWRIGHT_ABI {constants['ABI']})" in cmake
