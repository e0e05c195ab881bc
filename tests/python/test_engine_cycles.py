"""Modules of the engine do not depend on each other in circles: `engine/cycles.py` finds those that do."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

FILE = Path(__file__).parents[2] / "engine" / "cycles.py"


@pytest.fixture(scope="module")
def cycles() -> ModuleType:
    spec = importlib.util.spec_from_file_location("engine_cycles", FILE)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def found(cycles: ModuleType, folder: Path, **files: str) -> list[list[str]]:
    """The cycles of a crate with these files, `a__b` being `a/b.rs`."""
    for name, text in files.items():
        path = folder / f"{name.replace('__', '/')}.rs"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    graph = cycles.Crate(folder / "lib.rs").graph()
    return [["::".join(name) for name in cycle] for cycle in cycles.cycles(graph)]


def test_the_engine_has_none_but_the_known_ones(
    cycles: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cycles.main([]) == 0, capsys.readouterr().out


def test_all_crates_are_there(cycles: ModuleType) -> None:
    crates = {path.parent.relative_to(FILE.parent).as_posix() for path in FILE.parent.glob("*/*/Cargo.toml")}
    assert {*cycles.KNOWN, *cycles.ALL} <= crates
    arena = cycles.Crate(FILE.parent / "worlds" / "arena" / "src" / "lib.rs")
    assert set(arena.names[("sensing", "camera"), ("place", "color")]) == {"LedColor"}


@pytest.mark.parametrize(
    "text",
    [
        "use super::b::B;\npub struct A(B);",
        "use crate::{c::C, b::{self, B as Other}};\npub struct A;",
        "pub struct A;\nfn f() -> Option<crate::b::B> { None }",
        "pub struct A;\nuse super::b;\nfn f() { b::g() }",
        "pub struct A;\nuse super::b::*;",
        "pub struct A;\nmod inner { use super::super::b::B; }",
        "pub struct A;\nfn f(c: char) -> bool { c == '\"' || c == '\\'' && crate::b::IS }",
    ],
)
def test_two_that_name_each_other(cycles: ModuleType, tmp_path: Path, text: str) -> None:
    lib = "mod a;\nmod b;\nmod c;\n"
    other = "use crate::a::A;\npub struct B(A);"
    assert found(cycles, tmp_path, lib=lib, a=text, b=other, c="pub struct C;") == [["a", "b"]]


@pytest.mark.parametrize(
    "text",
    [
        "// use super::b::B;\npub struct A;",
        "/// See [`crate::b::B`].\npub struct A;",
        'pub struct A;\nconst TEXT: &str = "crate::b::B";',
        "pub struct A;\n#[cfg(test)]\nmod tests { use super::*; use crate::b::B; }",
        "pub struct A;\nuse std::{b::B, fmt};",
    ],
)
def test_what_names_nothing(cycles: ModuleType, tmp_path: Path, text: str) -> None:
    other = "use crate::a::A;\npub struct B(A);"
    assert found(cycles, tmp_path, lib="mod a;\nmod b;\n", a=text, b=other) == []


def test_a_re_export_is_of_the_module_that_defines_it(cycles: ModuleType, tmp_path: Path) -> None:
    folder = "mod b;\nmod c;\npub use b::B;\npub(crate) use c::*;\n"
    child = "use super::C;\npub struct B(C);"
    files = {"lib": "mod a;\n", "a__b": child, "a__c": "pub struct C;"}
    assert found(cycles, tmp_path, **files, a__mod=folder) == []
    files["a__c"] = "use crate::a::B;\npub struct C(Option<Box<B>>);"
    assert found(cycles, tmp_path, **files, a__mod=folder) == [["a::b", "a::c"]]


def test_a_field_with_the_name_of_a_module(cycles: ModuleType, tmp_path: Path) -> None:
    files = {"lib": "mod a;\n", "a__b": "use super::A;\npub struct B(A);"}
    assert found(cycles, tmp_path, **files, a__mod="mod b;\npub struct A { b: u8 }") == []


def test_a_folder_that_uses_what_uses_it(cycles: ModuleType, tmp_path: Path) -> None:
    files = {"lib": "mod a;\n", "a__b": "use super::A;\npub struct B(A);"}
    assert found(cycles, tmp_path, **files, a__mod="mod b;\npub struct A;\nfn f(_: b::B) {}") == [
        ["a", "a::b"]
    ]
    assert found(cycles, tmp_path, **files, a__mod="mod b;\npub struct A;\npub use b::B;") == []


def test_folders_between_whose_modules_there_is_none(cycles: ModuleType, tmp_path: Path) -> None:
    files = {
        "lib": "mod one;\nmod two;\n",
        "one__mod": "mod low;\nmod high;\n",
        "one__low": "pub struct Low;",
        "one__high": "use crate::two::middle::Middle;\npub struct High(Middle);",
        "two__mod": "pub mod middle;\n",
        "two__middle": "use crate::one::low::Low;\npub struct Middle(Low);",
    }
    assert found(cycles, tmp_path, **files) == []
    crate = cycles.Crate(tmp_path / "lib.rs")
    lines = list(cycles.problems(crate, [], False))
    assert lines == [
        "2 depend on each other: crate::one, crate::two",
        "  crate::one::high -> crate::two::middle: Middle",
        "  crate::two::middle -> crate::one::low: Low",
    ]
    assert list(cycles.problems(crate, [{"one", "two"}], False)) == []
    (gone,) = cycles.problems(crate, [{"one", "two"}, {"one", "three"}], True)
    assert gone == "no longer a cycle, to be taken from KNOWN: one, three"
