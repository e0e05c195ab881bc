"""Snapshots of what users read: messages, warnings, progress lines and reports, of Python and of the engine.

After a change of words, `pytest tests/python/test_texts.py --snapshot-update` writes the new ones; the
difference is what a reviewer reads. The `--help` pages are in docs/reference/command-line.md, which
`make check-docs` compares.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from syrupy.assertion import SnapshotAssertion
from syrupy.extensions.single_file import SingleFileSnapshotExtension, WriteMode

ROOT = Path(__file__).parents[2]
PRODUCT = ROOT / "python" / "swarmwright"
ENGINE = ROOT / "engine"
WORDS = 3
"""Texts with fewer words are names, keys and formats."""
ADDRESS = re.compile(r"swarmwright(\.\w+)+(:\w+)?")
"""A module or class by its name, as registries have them."""


class Texts(SingleFileSnapshotExtension):
    """One file a room, one line a text."""

    _write_mode = WriteMode.TEXT
    file_extension = "txt"


def words(text: str) -> int:
    return len(re.findall(r"(?<![\w{])[A-Za-z']{2,}(?![\w}(])", re.sub(r"\{[^}]*\}", "{}", text)))


def template(node: ast.expr) -> str | None:
    """Return the text of a literal or of an f-string, whose values stay expressions."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(
            f"{{{ast.unparse(part.value)}}}" if isinstance(part, ast.FormattedValue) else template(part) or ""
            for part in node.values
        )
    return None


def python_texts(node: ast.AST) -> Iterator[str]:
    """Yield the texts of a module, without docstrings and types."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
            continue
        if isinstance(child, ast.Call) and ast.unparse(child.func) == "cast":
            continue
        if isinstance(child, ast.expr) and (text := template(child)) is not None:
            yield text
        else:
            yield from python_texts(child)


RUST_TEXT = re.compile(
    r'//[^\n]*|/\*.*?\*/|b?r#*".*?"#*|b?"((?:[^"\\]|\\.)*)"|\'(?:[^\'\\]|\\.)\'', re.DOTALL
)


def rust_texts(source: str) -> Iterator[str]:
    """Yield the literals of a file before its tests."""
    for match in RUST_TEXT.finditer(source.split("#[cfg(test)]", maxsplit=1)[0]):
        if match[1]:
            yield re.sub(r"\\\n\s*", "", match[1]).replace('\\"', '"')


def rooms() -> dict[str, list[tuple[str, list[str]]]]:
    """Return the files of each room with their texts."""
    texts: dict[str, list[tuple[str, list[str]]]] = {}
    for path in sorted(PRODUCT.rglob("*.py")):
        room = path.relative_to(PRODUCT).parts[0].removesuffix(".py")
        tree = ast.parse(path.read_text("utf-8"))
        texts.setdefault(room, []).append((str(path.relative_to(PRODUCT)), [*python_texts(tree)]))
    for path in sorted(ENGINE.glob("*/**/src/**/*.rs")):
        name = path.relative_to(ENGINE)
        if not {"tests", "benches", "target"}.intersection(name.parts) and path.name != "tests.rs":
            texts.setdefault(f"engine-{name.parts[0]}", []).append(
                (str(name), [*rust_texts(path.read_text("utf-8"))])
            )
    return texts


def lines(texts: list[str]) -> list[str]:
    """Return those that are read by people, a line each."""
    return [" ".join(text.split()) for text in texts if words(text) >= WORDS and not ADDRESS.fullmatch(text)]


def listing(files: list[tuple[str, list[str]]]) -> str:
    """Return the texts of a room below the names of their files."""
    shown = [(name, lines(texts)) for name, texts in files]
    return "\n".join(f"{name}\n" + "".join(f"  {line}\n" for line in part) for name, part in shown if part)


LISTINGS = {room: text for room, files in rooms().items() if (text := listing(files))}


@pytest.mark.parametrize("room", LISTINGS)
def test_texts(room: str, snapshot: SnapshotAssertion) -> None:
    assert LISTINGS[room] == snapshot(extension_class=Texts)
