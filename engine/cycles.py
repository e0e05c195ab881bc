"""Find modules of the engine's crates that depend on each other in a circle.

`python engine/cycles.py` checks all crates, `python engine/cycles.py worlds/arena` prints every cycle of one.

A module depends on another one if its code names what the other one defines; a re-export leads to where that
is defined. Calls of methods and tests inside sources do not count. Checked are the files and folders beside
each other in the `src` of every crate, and in the crates of `ALL` also all modules, and what is beside each
other in every folder.
"""
# ruff: noqa: INP001 - a program

import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

ENGINE = Path(__file__).parent
ALL = ("roles/pool", "worlds/arena")
"""Crates without any cycle."""
KNOWN: dict[str, list[set[str]]] = {
    "bindings/c": [{"error", "input"}, {"foreign", "parallel"}],
    "bindings/fmi": [{"instance", "shield"}],
    "bindings/python": [
        {"lanes", "local", "physics", "simulation", "worlds"},
        {"pool", "producer", "remote"},
    ],
    "checks/schedules": [{"client", "simulator"}],
    "net/mqtt": [
        {"dialect", "publication", "session"},
        {"accounts", "settings"},
        {"connection", "handshake"},
    ],
    "net/protocol": [{"", "extension", "place", "status"}, {"messages", "presence"}],
    "numeric/controllers": [{"kinds", "lanes", "reader", "specification"}],
    "numeric/evolution": [{"differential", "polynomial"}],
    "numeric/lanes": [{"", "in_order", "level", "number", "portable", "x86"}],
    "worlds/simulation": [{"block", "rollout", "simulation", "together"}],
    "worlds/worlds": [{"emergency_exit", "minisim", "registry"}],
}
"""Cycles among what is beside each other in `src` that are still there; the root has an empty name."""

Name = tuple[str, ...]
"""A module of a crate: () is its root, ("metrics", "kind") is `crate::metrics::kind`."""
Graph = dict[Name, set[Name]]

_BLANK = re.compile(
    r"//[^\n]*"
    r"|/\*.*?\*/"
    r"|\bb?r(#*)\".*?\"\1"
    r"|\bb?\"(?:\\.|[^\"\\])*\"|\"(?:\\.|[^\"\\])*\""
    r"|'(?:\\.[^']*|[^'\\])'"
    r"|(?<=\bpub)\s*\([^()]*\)",
    re.DOTALL,
)
"""Comments, texts, characters and how far something is visible."""
_WORD = re.compile(r"[A-Za-z_]\w*|::|\S")
_TESTS = ["#", "[", "cfg", "(", "test", ")", "]"]
_ITEMS = {"const", "enum", "fn", "macro_rules", "static", "struct", "trait", "type", "union"}


def _step(word: str) -> int:
    """How a word changes the depth of braces."""
    return {"{": 1, "}": -1}.get(word, 0)


def _end(words: list[str], at: int) -> int:
    """Where the item ends that goes on with a word."""
    depth = 0
    for index in range(at, len(words)):
        depth += _step(words[index])
        if depth == 0 and words[index] in ";}":
            return index + 1
    return len(words)


def _branches(words: list[str], prefix: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield the names and paths of a `use` declaration, or of a part of it."""
    path = prefix
    for at, word in enumerate(words):
        if word == "{":
            depth, first = 0, at + 1
            for index in range(at, len(words)):
                depth += _step(words[index])
                if depth == 0 or (depth == 1 and words[index] == ","):
                    yield from _branches(words[first:index], path)
                    first = index + 1
            return
        if word == "as":
            yield words[at + 1], path
            return
        if word != "::" and (word != "self" or not path):
            path = [*path, word]
    if words:
        yield path[-1], path


@dataclass
class Module:
    """What the source of a module says."""

    children: set[str] = field(default_factory=set)
    """Modules within it that are files of their own."""
    items: set[str] = field(default_factory=set)
    """What it defines otherwise."""
    imports: dict[str, list[str]] = field(default_factory=dict)
    """Paths by the name that they have here."""
    exported: set[str] = field(default_factory=set)
    """Which of these are re-exports."""
    globs: list[list[str]] = field(default_factory=list)
    """Paths of which it imports everything."""
    paths: list[list[str]] = field(default_factory=list)
    """What its code names."""

    @classmethod
    def read(cls, text: str) -> "Module":
        """Read a source."""
        module = cls()
        words = _WORD.findall(_BLANK.sub(" ", text))
        inline: list[int] = []  # The depths of braces within modules that are not files of their own.
        depth = at = 0
        while at < len(words):
            word, before = words[at], words[at - 1] if at else ""
            if words[at : at + len(_TESTS)] == _TESTS:
                at = _end(words, at + len(_TESTS))
            elif word == "use":
                end = words.index(";", at)
                module._use(words[at + 1 : end], before == "pub", bool(inline))
                at = end + 1
            elif word == "mod" and words[at + 2] == ";":
                module.children.add(words[at + 1])
                at += 3
            elif word == "mod" and words[at + 2] == "{":
                depth += 1
                inline.append(depth)
                at += 3
            elif word in _ITEMS and depth == 0:
                module.items.add(next(name for name in words[at + 1 :] if name != "!"))
                at += 1
            elif re.match(r"\w", word) and before not in ("::", "."):
                at = module._path(words, at, bool(inline))
            else:
                depth += _step(word)
                if inline and depth < inline[-1]:
                    inline.pop()
                at += 1
        return module

    def _use(self, words: list[str], exported: bool, inline: bool) -> None:
        for name, path in _branches(words, []):
            if inline:
                self.paths.append(path[1:] if path[0] == "super" and len(path) > 1 else path)
            elif name == "*":
                self.globs.append(path[:-1])
            elif name == "_":
                self.paths.append(path)
            else:
                self.imports[name] = path
                self.exported |= {name} if exported else set()

    def _path(self, words: list[str], at: int, inline: bool) -> int:
        """Note a path, and return where it ends."""
        path = [words[at]]
        at += 1
        while at + 1 < len(words) and words[at] == "::" and re.match(r"\w", words[at + 1]):
            path.append(words[at + 1])
            at += 2
        self.paths.append(path[1:] if inline and path[0] == "super" and len(path) > 1 else path)
        return at


class Crate:
    """The modules of a crate, and which of them name what of which."""

    def __init__(self, source: Path) -> None:
        """Read the sources, beginning with the file of the root."""
        self.modules: dict[Name, Module] = {}
        waiting: list[tuple[Name, Path, Path]] = [((), source, source.parent)]
        while waiting:
            name, file, folder = waiting.pop()
            self.modules[name] = Module.read(file.read_text(encoding="utf-8"))
            for child in sorted(self.modules[name].children):
                files = [folder / f"{child}.rs", folder / child / "mod.rs"]
                waiting.append(
                    ((*name, child), next(file for file in files if file.is_file()), folder / child)
                )
        self.names: dict[tuple[Name, Name], set[str]] = {}
        """Why a module depends on another one: what it names of it."""
        for name, module in self.modules.items():
            used = {path[0] for path in module.paths}
            imports = module.imports.items()
            imported = [path for alias, path in imports if alias in used or alias not in module.exported]
            # A name alone, as of a field, is never that of a module.
            named = [path for path in module.paths if len(path) > 1 or path[0] not in module.children]
            for path in [*imported, *named, *([*path, "*"] for path in module.globs)]:
                target = self.resolve(name, path)
                if target is not None and target[0] != name:
                    self.names.setdefault((name, target[0]), set()).add(target[1])

    def resolve(self, name: Name, path: list[str], depth: int = 0) -> tuple[Name, str] | None:
        """Find the module that defines what a path in a module names; none for what is of another crate."""
        first, rest = path[0], path[1:]
        module = self.modules[name]
        if first == "crate":
            return self._within((), rest, depth)
        if first == "self":
            return self._within(name, rest, depth)
        if first == "super":
            name = name[:-1]
            return (
                self.resolve(name, rest, depth) if rest[:1] == ["super"] else self._within(name, rest, depth)
            )
        if first in module.imports and module.imports[first] != path and depth < 20:
            return self.resolve(name, [*module.imports[first], *rest], depth + 1)
        return self._within(name, path, depth) if first in module.children else None

    def _within(self, name: Name, path: list[str], depth: int) -> tuple[Name, str] | None:
        if not path:
            return name, "self"
        module = self.modules[name]
        first, rest = path[0], path[1:]
        if first in module.children:
            return self._within((*name, first), rest, depth)
        if first in module.imports and depth < 20:
            return self.resolve(name, [*module.imports[first], *rest], depth + 1)
        if first not in module.items and depth < 20:
            for glob in module.globs:
                found = self.resolve(name, [*glob, first], depth + 1)
                if found is not None and first in self.modules[found[0]].items:
                    return found
        return name, first

    def graph(self) -> Graph:
        """Return which modules each module depends on."""
        graph: Graph = {name: set() for name in self.modules}
        for name, other in self.names:
            graph[name].add(other)
        return graph

    def beside(self, folder: Name) -> Graph:
        """Return the same of what is beside each other in a folder, and of the folder's own file."""
        size = len(folder)
        graph: Graph = {}
        for name, others in self.graph().items():
            if name[:size] == folder:
                within = {other[: size + 1] for other in others if other[:size] == folder}
                graph.setdefault(name[: size + 1], set()).update(within - {name[: size + 1]})
        return graph


def cycles(graph: Graph) -> list[list[Name]]:
    """Find the sets of modules that depend on each other in circles, the largest first."""

    def reached(start: Name) -> set[Name]:
        found: set[Name] = set()
        waiting = [start]
        while waiting:
            new = graph[waiting.pop()] - found
            found |= new
            waiting += new
        return found

    reach = {name: reached(name) for name in graph}
    found = {frozenset(other for other in reach[name] if name in reach[other]) for name in graph}
    return sorted((sorted(cycle) for cycle in found if cycle), key=lambda cycle: (-len(cycle), cycle))


def written(name: Name) -> str:
    """Return a module as Rust names it."""
    return "::".join(("crate", *name))


def described(crate: Crate, cycle: list[Name], where: str = "") -> Iterator[str]:
    """Describe a cycle, with what its modules name of each other."""
    yield f"{len(cycle)} depend on each other{where}: {', '.join(map(written, cycle))}"

    def part(name: Name) -> Name | None:
        return max((part for part in cycle if name[: len(part)] == part), key=len, default=None)

    for (name, other), names in sorted(crate.names.items()):
        one, two = part(name), part(other)
        if one is not None and two is not None and one != two:
            yield f"  {written(name)} -> {written(other)}: {', '.join(sorted(names))}"


def problems(crate: Crate, known: list[set[str]], everywhere: bool) -> Iterator[str]:
    """Describe what is wrong in a crate: cycles that are not known, and known ones that are gone."""
    found = cycles(crate.beside(()))
    names = [{"::".join(name) for name in cycle} for cycle in found]
    for cycle, members in zip(found, names, strict=True):
        if members not in known:
            yield from described(crate, cycle)
    for gone in known:
        if gone not in names:
            yield f"no longer a cycle, to be taken from KNOWN: {', '.join(sorted(gone))}"
    if everywhere:
        for cycle in cycles(crate.graph()):
            yield from described(crate, cycle, " as modules")
        for folder in sorted({name[:size] for name in crate.modules for size in range(1, len(name))}):
            for cycle in cycles(crate.beside(folder)):
                yield from described(crate, cycle, f" in {written(folder)}")


def main(crates: Iterable[str]) -> int:
    """Print what is wrong in all crates, or every cycle of some; 1 where there is something."""
    found = False
    named = set(crates)
    for manifest in sorted(ENGINE.glob("*/*/Cargo.toml")):
        name = manifest.parent.relative_to(ENGINE).as_posix()
        source = manifest.parent / "src" / "lib.rs"
        if named and name not in named:
            continue
        crate = Crate(source)
        known = [] if named else KNOWN.get(name, [])
        lines = list(problems(crate, known, bool(named) or name in ALL))
        if named or lines:
            print(f"{source.relative_to(ENGINE)}: {len(crate.modules)} modules", *lines, sep="\n")
        found = found or bool(lines)
    return int(found)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
