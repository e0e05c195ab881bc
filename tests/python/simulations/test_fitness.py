"""Fitness expressions: what they compute, what is refused, and what becomes of episodes without a value."""

import ast
import json
import math
import operator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmwright import Experiment, InputError, RunError, evaluate, optimize, simulate
from swarmwright.cli._commands import program
from swarmwright.common.random_numbers import Stream
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.simulations.fitness import ExpressionError, FitnessExpression

MINISIM = Experiment.from_mapping(
    {
        "simulation": "minisim",
        "parameters": {"placement": "random", "numAgents": 3},
        "ranking": {"episodes": 3},
        "method": {"population": 8, "generations": 2},
        "servers": "local",
    }
)
MODES = ["stepwise", "batched", "offloaded"]


def genomes(count: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    representation = MINISIM.representation()
    return np.stack([representation.initial(Stream(1, "test", 0, index)) for index in range(count)])


def value(text: str, **numbers: float) -> float | str:
    """The value for one evaluation, or why there is none."""
    expression = FitnessExpression(text)
    metrics = np.array([[numbers[name] for name in expression.metrics]])
    values, faults = expression(np.array([numbers.get("fitness", 0.0)]), metrics)
    assert bool(faults) == math.isnan(values[0])
    return faults[0].reason if faults else float(values[0])


def test_a_metric_without_a_value_is_named_as_such() -> None:
    assert value("2 * a", a=math.nan) == "a value that is not a number (NaN) in '2 * a'"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a", 3.0),
        ("-a + b * 2 - 1", -3.0 + 0.5 * 2 - 1),
        ("a / b", 6.0),
        ("2 ** a if a > 5 else a ** 3", None),  # an exponent is a constant
        ("a ** 3 - a ** -2", 27 - 1 / 9),
        ("-a ** 2", -9.0),
        ("a ** 0", 1.0),
        ("fitness - 0.01 * a", -4.0 - 0.01 * 3),
        ("1 if a == 3 else 0", 1.0),
        ("(a > b) + (a <= b) * 10", 1.0),
        ("0 < b < 1 < a", 1.0),
        ("0 < b < 0.2", 0.0),
        ("not a", 0.0),
        ("a and b", 0.5),
        ("b - 0.5 or a", 3.0),
        ("b - 0.5 and 1 / 0", 0.0),
        ("max(a, b, -1) + min(a, b, 7)", 3.5),
        ("clip(a, 0, 1) + clip(-a, 0, 1)", 1.0),
        ("abs(-a) + sqrt(a * a)", 6.0),
        ("1 / (a - 3) if a != 3 else -1", -1.0),
        ("a if a < 0 else b if b < 0 else 9", 9.0),
        ("  a  ", 3.0),
        ("1_000 * a + 1e-3", 3000.001),
    ],
)
def test_value(text: str, expected: float | None) -> None:
    if expected is None:
        with pytest.raises(ExpressionError, match="exponent 'a' must be a whole number"):
            FitnessExpression(text)
    else:
        assert value(text, a=3.0, b=0.5, fitness=-4.0) == expected


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1 / (a - 3)", "division by zero in '1 / (a - 3)'"),
        ("0 / (a - 3)", "division by zero in '0 / (a - 3)'"),
        ("(a - 3) ** -1", "division by zero in '(a - 3) ** -1'"),
        ("sqrt(-a)", "the square root of a negative number in 'sqrt(-a)'"),
        ("a * 1e308", "a number too large in 'a * 1e308'"),
        ("(a * 1e300) ** 2", "a number too large in '(a * 1e300) ** 2'"),
        # What would be finite again in the end is not: 1 / inf is no 0 here.
        ("1 / (1 / (a - 3))", "division by zero in '1 / (a - 3)'"),
        ("min(a, 1 / (a - 3))", "division by zero in '1 / (a - 3)'"),
        ("1 if 1 / (a - 3) > 0 else 0", "division by zero in '1 / (a - 3)'"),
    ],
)
def test_no_value(text: str, reason: str) -> None:
    assert value(text, a=3.0) == reason


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not a valid expression"),
        ("a +", "not a valid expression: invalid syntax"),
        ("a; b", "not a valid expression"),
        ("a = 1", "not a valid expression"),
        ("\x00", "not a valid expression"),
        ("(" * 300 + "a" + ")" * 300, "not a valid expression"),
        ("-" * 900 + "a", "nested too deeply"),
        ("a" * 1001, "has 1001 characters; at most 1000"),
        ("1 + 2", "uses no metric"),
        ("a.b", "'a.b' is not allowed in a fitness expression"),
        ("a[0]", "is not allowed"),
        ("[a]", "is not allowed"),
        ("lambda: a", "is not allowed"),
        ("(a := 2)", "is not allowed"),
        ("a // 2", "is not allowed"),
        ("a % 2", "is not allowed"),
        ("a @ b", "is not allowed"),
        ("~a", "is not allowed"),
        ("a is b", "is not allowed"),
        ("a in (1, 2)", "is not allowed"),
        ("f'{a}'", "is not allowed"),
        ("[x for x in a]", "is not allowed"),
        ("exp(a)", "there is no function 'exp'"),
        ("sqr(a)", r"there is no function 'sqr'; did you mean 'sqrt'\?"),
        ("__import__('os')", "there is no function '__import__'"),
        ("a.__class__()", "there is no function 'a.__class__'"),
        ("min(a)", r"min is used as min\(a, b, ...\)"),
        ("min(*a, b)", "min is used as"),
        ("abs(x=a)", r"abs is used as abs\(x\)"),
        ("clip(a, 1)", r"clip is used as clip\(x, low, high\)"),
        ("a ** 0.5", "exponent '0.5' must be a whole number from -64 to 64"),
        ("a ** 65", "exponent '65'"),
        ("a ** b", "exponent 'b'"),
        ("a ** True", "exponent 'True'"),
        ("a * True", "True is not a number"),
        ("a * 'b'", "'b' is not a number"),
        ("a * 1j", "1j is not a number"),
        ("a * 1e999", "a number is too large"),
        ("a * 1" + "0" * 400, "a number is too large"),
        ("a * ...", "is not a number"),
    ],
)
def test_refused(text: str, words: str) -> None:
    with pytest.raises(ExpressionError, match=words):
        FitnessExpression(text)


numbers = st.floats(-4, 4).map(lambda number: round(number * 2) / 2) | st.floats(-1e200, 1e200)


def combined(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    binary = st.tuples(
        inner, st.sampled_from(["+", "-", "*", "/", "<", "<=", "==", "!=", "and", "or"]), inner
    )
    return (
        binary.map(lambda parts: f"({' '.join(parts)})")
        | st.tuples(inner, inner, inner).map(lambda p: f"({p[0]} if {p[1]} else {p[2]})")
        | st.tuples(inner, inner).map(lambda p: f"min({p[0]}, {p[1]})")
        | st.tuples(inner, inner).map(lambda p: f"max({p[0]}, {p[1]})")
        | inner.map(lambda part: f"(-{part})")
        | inner.map(lambda part: f"abs({part})")
        | inner.map(lambda part: f"(not {part})")
        | st.tuples(inner, st.integers(0, 5)).map(lambda p: f"({p[0]} ** {p[1]})")
    )


expressions = st.recursive(st.sampled_from(["a", "b", "fitness", "0", "2", "0.1"]), combined, max_leaves=12)


BINARY = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
COMPARED = {ast.Lt: operator.lt, ast.LtE: operator.le, ast.Eq: operator.eq, ast.NotEq: operator.ne}


def reference(node: ast.AST, names: dict[str, float]) -> float:  # noqa: C901 - a case each
    """The value of one evaluation in Python's own numbers. Raises ArithmeticError where it has none."""

    def of(inner: ast.AST) -> float:
        return reference(inner, names)

    match node:
        case ast.Expression(body=body):
            return of(body)
        case ast.Constant(value=float() | int() as value):
            return float(value)
        case ast.Name(id=name):
            return names[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -of(operand)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return float(not of(operand))
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int() as exponent)):
            return finite(math.prod([of(left)] * exponent, start=1.0))
        case ast.BinOp(left=left, op=operation, right=right):
            return finite(BINARY[type(operation)](of(left), of(right)))
        case ast.BoolOp(op=ast.And(), values=[left, right]):
            return of(left) and of(right)
        case ast.BoolOp(op=ast.Or(), values=[left, right]):
            return of(left) or of(right)
        case ast.Compare(left=left, ops=[operation], comparators=[right]):
            return float(COMPARED[type(operation)](of(left), of(right)))
        case ast.IfExp(test=test, body=body, orelse=orelse):
            return of(body) if of(test) else of(orelse)
        case ast.Call(func=ast.Name(id="abs"), args=[argument]):
            return abs(of(argument))
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return {"min": min, "max": max}[name](*map(of, arguments))
    raise AssertionError(ast.dump(node))


def finite(number: float) -> float:
    if math.isfinite(number):
        return number
    raise OverflowError


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(text=expressions, rows=st.lists(st.tuples(numbers, numbers, numbers), min_size=1, max_size=5))
def test_arrays_give_what_python_gives_one_by_one(text: str, rows: list[tuple[float, float, float]]) -> None:
    text = f"{text} + 0 * a"
    expression = FitnessExpression(text)
    columns = {"a": 0, "b": 1}
    metrics = np.array([[row[columns[name]] for name in expression.metrics] for row in rows])
    metrics = metrics.reshape(len(rows), len(expression.metrics))
    values, faults = expression(np.array([row[2] for row in rows]), metrics)
    tree, expected = ast.parse(text, mode="eval"), []
    for a, b, own in rows:
        try:
            expected.append(reference(tree, {"a": a, "b": b, "fitness": own}))
        except ArithmeticError:
            expected.append(math.nan)
    assert [fault.index for fault in faults] == [i for i, one in enumerate(expected) if math.isnan(one)]
    assert np.array_equal(values, np.array(expected) + 0.0, equal_nan=True)


def test_the_whole_of_a_file_s_mistake_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    for fitness, words in [
        ("arived - steps", "a.yaml:2: fitness: 'arived' is not a metric of minisim; did you mean 'arrived'"),
        ("arived - steps", "'arrived'? available: arrived, caught, distance, steps, fitness"),
        ("arrived(", "a.yaml:2: fitness: 'arrived(' is not a valid expression"),
        ("os.system", "a.yaml:2: fitness: 'os.system' is not allowed"),
    ]:
        path.write_text(f"simulation: minisim\nfitness: {json.dumps(fitness)}\n")
        with pytest.raises(InputError) as raised:
            Experiment.load(path)
        assert words in str(raised.value)
    path.write_text("simulation: minisim\nfitness: 3\n")
    with pytest.raises(InputError, match=r"a\.yaml:2: fitness: must be text, not 3"):
        Experiment.load(path)


def test_it_is_part_of_the_experiment(tmp_path: Path) -> None:
    experiment = MINISIM.replace(fitness="arrived - 0.01 * steps")
    experiment.save(tmp_path / "a.yaml")
    assert Experiment.load(tmp_path / "a.yaml") == experiment
    assert experiment.replace(fitness=None) == MINISIM
    assert "fitness" not in MINISIM.to_mapping()


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_the_same_in_every_mode(mode: str) -> None:
    text = "2 * arrived - caught - 0.01 * steps + fitness / (1 + distance)"
    experiment = MINISIM.replace(fitness=text, mode=mode)
    rows = genomes(20)
    here = evaluate(experiment, rows)
    assert np.isfinite(here).all()
    assert len(set(here.tolist())) > 5
    assert here.tobytes() == evaluate(experiment, rows, servers=2).tobytes()


def test_the_ranking_sees_the_expression_s_values() -> None:
    rows = genomes(6)
    with open_backend(MINISIM.replace(fitness="arrived + 10 * caught + 100 * fitness")) as backend:
        controllers = Controllers.from_genomes(MINISIM.representation(), rows)
        results = backend.evaluate(controllers, [0, 1, 2], lambda *_: None)
    with open_backend(MINISIM) as backend:
        own = backend.evaluate(controllers, [0, 1, 2], lambda *_: None)
    assert results.metrics.shape == (6, 3, 2)
    assert own.metrics.shape == (6, 3, 0)
    expected = results.metrics[..., 0] + 10 * results.metrics[..., 1] + 100 * own.fitness
    assert np.array_equal(results.fitness, expected)


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["local", 1])
def test_an_episode_without_a_value_has_failed(servers: Any, tmp_path: Path) -> None:
    experiment = MINISIM.replace(
        fitness="1 / (steps - 15)", parameters={"numDefenders": 3, "mapWidth": 8, "mapHeight": 5}
    )
    run = optimize(experiment, servers=servers, out=tmp_path / "run")
    failed = int(np.isnan(run.record.episodes).sum())
    assert 0 < failed < run.record.episodes.size
    expected = [
        f"candidate {run.record.candidate[row]}, episode {episode}: "
        "fitness: division by zero in '1 / (steps - 15)'"
        for row, episode in np.argwhere(np.isnan(run.record.episodes))
    ]
    assert [event.text for event in run.events()] == [*expected, f"failed: {failed}"]
    always = experiment.replace(fitness="1 / (steps - steps)")
    with pytest.raises(RunError, match="failed; the last reason: fitness: division by zero"):
        optimize(always, servers=servers, out=tmp_path / "none")
    with pytest.raises(RunError, match="the episode failed: fitness: division by zero"):
        simulate(always, servers=servers)


def test_simulate_gives_the_expression_s_value() -> None:
    steps = simulate(MINISIM.replace(fitness="steps"))
    assert 1 <= steps <= 15
    assert simulate(MINISIM.replace(fitness="-0.5 * steps")) == -0.5 * steps


def test_the_record_holds_the_metrics_and_replay_gives_the_same_fitness(tmp_path: Path) -> None:
    experiment = MINISIM.replace(fitness="steps - 10 * distance", ranking={"episodes": 2})
    run = optimize(experiment, out=tmp_path / "run")
    assert run.metrics == ["distance", "steps"]
    distance, steps = np.moveaxis(run.record.metrics, -1, 0)
    assert np.array_equal(run.record.episodes, steps - 10 * distance + 0.0)
    best = run.evaluation(run.best.candidate, run.best.generation)
    for episode in range(2):
        result = CliRunner().invoke(program, ["replay", str(run.path), "--json", "--episode", str(episode)])
        assert result.exit_code == 0, result.output
        assert json.loads(result.output.splitlines()[-1])["fitness"] == best.episodes[episode]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("caught\n  - 0.5 * arrived\n", 1.0),
        ("caught * 2  # of those that were caught\n+ arrived * 100", 204.0),
        ("min(caught, # the fewer\n arrived)", 2.0),
        ("caught\r\n+ arrived", 4.0),
        ("caught\narrived", "is not a valid expression"),
        ("caught)\n+ (arrived", "is not a valid expression"),
    ],
)
def test_an_expression_of_several_lines(text: str, expected: float | str) -> None:
    if isinstance(expected, str):
        with pytest.raises(ExpressionError, match=expected):
            FitnessExpression(text)
    else:
        assert value(text, caught=2.0, arrived=2.0) == expected
