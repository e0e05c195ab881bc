"""Guards that no other tool has: cycles of imports, decisions by words of errors."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

import swarmwright

ROOT = Path(swarmwright.__file__).parent
MODULES = {
    ".".join(("swarmwright", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in sorted(ROOT.rglob("*.py"))
}

KNOWN_CYCLES = [
    # `Experiment.load` and `replace` check targets, which are experiments; what is evolved may start from the
    # controllers of a run, which has one.
    {
        "swarmwright.experiment.checks",
        "swarmwright.experiment.experiment",
        "swarmwright.experiment.ranges",
        "swarmwright.experiment.start_from",
        "swarmwright.experiment.targets",
        "swarmwright.experiment.validation",
    },
    # `Run` has methods that evaluate it again, and these make runs.
    {
        "swarmwright.runs.metric_curves",
        "swarmwright.runs.post_evaluation",
        "swarmwright.runs.run",
        "swarmwright.runs.transfer.at_end",
        "swarmwright.runs.transfer.evaluation",
        "swarmwright.runs.validation",
    },
]

READ = {
    "cli/_main.py": "CPython and Rayon tell only in words that no thread could be started",
    "export/c_family.py": "compilers refuse -march=native in words",
    "servers/broker/waiting.py": "shortens the line that is printed",
    "servers/launchers/kubernetes.py": "urllib3 puts the cause behind its own words",
    "servers/launchers/_ray_cluster.py": "Ray puts a traceback into its message",
    "servers/launchers/slurm.py": "sbatch tells only in words that it timed out",
    "simulations/catalogue.py": "TypeError of constructors of environments",
    "simulations/command/logs.py": "csv.Error has no code",
    "simulations/gymnasium.py": "errors of Gymnasium and of unpacking have no code",
    "simulations/loading.py": "ImportError of relative imports has no code",
}
"""Files that decide by the words of an exception, all of other libraries, and why."""


def imports(tree: ast.AST, module: str, package: str) -> Iterator[str]:
    """Yield the modules that a module imports anywhere, but for annotations."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            continue
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.rsplit(".", node.level - 1)[0] if node.level else ""
            base = ".".join(filter(None, (above, node.module)))
            names = [f"{base}.{one.name}" for one in node.names]
            yield from (name if name in MODULES else base for name in names if name != "swarmwright._engine")
        yield from imports(node, module, package)


class Scanned(NamedTuple):
    """What a module has."""

    imports: set[str]
    words_of_errors: list[int]


@cache
def scanned() -> dict[str, Scanned]:
    """Return what all modules have. Their trees are not kept: the garbage collector would walk them."""
    found = {}
    for module, path in MODULES.items():
        package = module if path.name == "__init__.py" else module.rpartition(".")[0]
        tree = ast.parse(path.read_text("utf-8"))
        imported = {one for one in imports(tree, module, package) if one in MODULES and one != module}
        found[module] = Scanned(imported, list(words_of_errors(tree)))
    return found


def cycles() -> list[set[str]]:
    """Return the sets of modules that import each other (Tarjan's strongly connected components)."""
    graph = {module: one.imports for module, one in scanned().items()}
    left = set(graph)
    importers = {module: {one for one in graph if module in graph[one]} for module in graph}
    # What imports nothing else, or is imported by nothing else, of what is left is in no cycle.
    while loose := [one for one in left if not graph[one] & left or not importers[one] & left]:
        left.difference_update(loose)
    within = {module: graph[module] & left for module in left}
    reached = {module: reachable(within, module) for module in within}
    components = [
        frozenset({module, *(one for one in reached[module] if module in reached[one])}) for module in within
    ]
    return [set(one) for one in dict.fromkeys(components) if len(one) > 1]


def reachable(graph: dict[str, set[str]], start: str) -> set[str]:
    found: set[str] = set()
    left = [*graph[start]]
    while left:
        one = left.pop()
        if one not in found:
            found.add(one)
            left += graph[one]
    return found


def test_modules_do_not_import_each_other_in_circles() -> None:
    """Also not through imports in functions."""
    new = [sorted(one) for one in cycles() if not any(one <= known for known in KNOWN_CYCLES)]
    assert not new, "these modules import each other; move what they share below both"


def words_of_errors(tree: ast.AST) -> Iterator[int]:
    """Yield the lines in which something is decided by the text of an exception."""
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        errors = {node.name for node in ast.walk(function) if isinstance(node, ast.ExceptHandler)}
        for argument in (*function.args.args, *function.args.kwonlyargs):
            kind = "" if argument.annotation is None else ast.unparse(argument.annotation)
            if "Error" in kind or "Exception" in kind:
                errors.add(argument.arg)
        if errors <= {None}:
            continue
        texts = {
            node.targets[0].id
            for node in ast.walk(function)
            if isinstance(node, ast.Assign)
            and isinstance(node.targets[0], ast.Name)
            and is_text(node.value, errors, set())
        }
        yield from (
            node.lineno
            for node in ast.walk(function)
            if isinstance(node, ast.Compare | ast.Call) and decides(node, errors, texts)
        )


def decides(node: ast.Compare | ast.Call, errors: set[str | None], texts: set[str]) -> bool:
    if isinstance(node, ast.Compare):
        is_tested = not any(isinstance(one, ast.Is | ast.IsNot) for one in node.ops)
        return is_tested and any(is_text(one, errors, texts) for one in (node.left, *node.comparators))
    if not isinstance(node.func, ast.Attribute):
        return False
    if node.func.attr in {"startswith", "endswith", "partition", "rpartition", "find", "index", "count"}:
        return is_text(node.func.value, errors, texts)
    if node.func.attr in {"match", "search", "fullmatch", "findall", "finditer"}:
        return any(is_text(one, errors, texts) for one in node.args)
    return False


def is_text(node: ast.expr, errors: set[str | None], texts: set[str]) -> bool:
    """Return whether an expression is the text of an exception."""
    if isinstance(node, ast.Name):
        return node.id in texts
    if isinstance(node, ast.Subscript):  # error.args[0]
        of = node.value
        return isinstance(of, ast.Attribute) and of.attr == "args"
    if not isinstance(node, ast.Call):
        return False
    if isinstance(node.func, ast.Attribute) and node.func.attr in {"casefold", "lower", "strip"}:
        return is_text(node.func.value, errors, texts)
    given = node.args[0] if node.args else None
    return (
        isinstance(node.func, ast.Name)
        and node.func.id in {"str", "repr"}
        and isinstance(given, ast.Name)
        and given.id in errors
    )


def test_no_decision_is_made_by_the_words_of_an_error() -> None:
    """Errors that code tells apart have a class or an attribute; words are for people."""
    found = {
        str(MODULES[module].relative_to(ROOT)): one.words_of_errors
        for module, one in scanned().items()
        if one.words_of_errors
    }
    assert found.keys() == READ.keys(), found


@pytest.mark.parametrize(
    "code",
    [
        "def f():\n try: pass\n except ValueError as error:\n  if 'gone' in str(error): pass",
        "def f(error: ValueError): return str(error).startswith('gone')",
        "def f(error: ValueError):\n text = str(error)\n return re.match('gone', text)",
        "def f(error: ValueError): return error.args[0] == 'gone'",
    ],
)
def test_decisions_by_words_are_found(code: str) -> None:
    assert list(words_of_errors(ast.parse(code)))
