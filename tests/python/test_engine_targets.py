"""No test of the engine is left out by its manifests, which name what is compiled as a test."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ENGINE = Path(__file__).parents[2] / "engine"
CRATES = sorted(path.parent for path in ENGINE.glob("*/*/Cargo.toml"))


def test_there_are_crates() -> None:
    assert len(CRATES) > 15


def manifest(crate: Path) -> dict[str, Any]:
    return tomllib.loads((crate / "Cargo.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("crate", CRATES, ids=lambda crate: crate.name)
def test_every_file_of_tests_is_part_of_a_program(crate: Path) -> None:
    found = manifest(crate)
    if found["package"].get("autotests", True):
        assert not (crate / "tests" / "all.rs").exists()
        return
    programs = [crate / target.get("path", f"tests/{target['name']}.rs") for target in found["test"]]
    modules = re.findall(
        r"^mod (\w+);$", (crate / "tests" / "all.rs").read_text(encoding="utf-8"), re.MULTILINE
    )
    files = {path for path in (crate / "tests").glob("*.rs") if path not in programs}
    folders = (crate / "tests").glob("*/mod.rs")
    assert {path.stem for path in files} | {path.parent.name for path in folders} == set(modules)
    assert set((crate / "tests").glob("*/main.rs")) <= set(programs)


def included(crate: Path) -> Iterator[Path]:
    """Sources that files of tests include."""
    for path in (crate / "tests").glob("*.rs"):
        for name in re.findall(r'^#\[path = "(.+)"\]$', path.read_text(encoding="utf-8"), re.MULTILINE):
            yield (path.parent / name).resolve()


@pytest.mark.parametrize("crate", CRATES, ids=lambda crate: crate.name)
def test_what_is_not_compiled_as_a_test_has_none(crate: Path) -> None:
    found = manifest(crate)
    files = {path.resolve(): path.read_text(encoding="utf-8") for path in (crate / "src").rglob("*.rs")}
    source = "".join(files.values())
    library = found.get("lib", {})
    targets = [library, *found.get("bin", [])]
    if not all(target.get("test", True) for target in targets):
        tested = {path for path, text in files.items() if re.search(r"#\[test\]|proptest!|cfg\(test\)", text)}
        assert tested <= set(included(crate))
    if not library.get("doctest", True):
        assert not re.search(r"^\s*//[/!] ```(?!text)\S*\n\s*//[/!] [^`]", source, re.MULTILINE)
