"""What a user's method, representation or ranking raises or returns is reported with class, file and line."""

import re
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, RunError, optimize, resume
from swarmwright.cli._main import run as swarmwright
from swarmwright.common.errors import PlugInError
from swarmwright.methods.plug_ins import REGISTRIES

CODE = '''
from typing import Literal

import numpy as np

from swarmwright.methods import Method, MethodOptions
from swarmwright.methods.rankings import Ranking, RankingOptions
from swarmwright.controllers.kinds.fully_meshed import FullyMeshed, FullyMeshedOptions


class DrawOptions(MethodOptions):
    """Draws."""

    kind: Literal["draw"] = "draw"


class Draw(Method):
    kind = "draw"
    options_model = DrawOptions
    steady_state = True
    generation_size = 4
    _scores = np.empty(0)

    @property
    def budget(self):
        return 4 * self.options.generations

    @property
    def population_fitness(self):
        return self._scores

    def _ask(self):
        return self.initials(range(4))

    def _tell(self, genomes, fitness):
        self._scores = fitness
        helper(self.generation)

    def _ask_next(self, index):
        return self.initial_of(index)

    def _tell_next(self, index, genome, fitness):
        self._scores = np.array([fitness])


def helper(generation):
    return 1


class NetOptions(FullyMeshedOptions):
    """A network."""

    kind: Literal["net"] = "net"


class Net(FullyMeshed):
    kind = "net"
    options_model = NetOptions

    def architecture(self):
        return {**super().architecture(), "kind": "fully_meshed"}

    def initial(self, stream):
        return super().initial(stream)


class MeanOptions(RankingOptions):
    """The mean."""

    kind: Literal["own_mean"] = "own_mean"


class Mean(Ranking):
    kind = "own_mean"
    options_model = MeanOptions

    def _score(self, episodes):
        return np.array([sum(row) for row in episodes])
'''
PLUG_INS = {"method": ("draw", "Draw"), "controller": ("net", "Net"), "ranking": ("own_mean", "Mean")}
Install = Callable[..., Callable[[], Experiment]]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install the package, edited, and return what loads an experiment that uses it."""

    def install(old: str = "", new: str = "", **method: Any) -> Callable[[], Experiment]:
        assert old in CODE
        (tmp_path / "owned.py").write_text(CODE.replace(old, new, 1))
        monkeypatch.syspath_prepend(str(tmp_path))
        monkeypatch.delitem(sys.modules, "owned", raising=False)
        for section, (kind, name) in PLUG_INS.items():
            registry = REGISTRIES[section]
            point = EntryPoint(kind, f"owned:{name}", registry.group)
            monkeypatch.setitem(vars(registry), "_entry_points", {kind: [point]})
            monkeypatch.setattr(registry, "_loaded", {})
        monkeypatch.setattr("sys.dont_write_bytecode", True)
        monkeypatch.chdir(tmp_path)
        (tmp_path / "owned.yaml").write_text(
            "simulation: minisim\ncontroller: {kind: net}\nranking: {kind: own_mean}\n"
            "method: {kind: draw, generations: 4}\nparameters: {maxSteps: 5}\nservers: local\n"
        )
        settings = [f"method.{key}={value}" for key, value in method.items()]
        return lambda: Experiment.load("owned.yaml", settings)

    return install


def test_plug_ins_without_mistakes(install: Install, tmp_path: Path) -> None:
    assert optimize(install()(), out=tmp_path / "run").generations == 4
    steady = install(operation="steady_state", in_flight=2)
    assert optimize(steady(), out=tmp_path / "steady").generations == 4


def test_a_method_that_raises_keeps_what_was_computed(install: Install, tmp_path: Path) -> None:
    experiment = install("    return 1\n", "    return 1 / (2 - generation)\n")
    line = next(number for number, text in enumerate(CODE.splitlines(), 1) if text == "    return 1")
    wanted = rf"^Draw\._tell: ZeroDivisionError: division by zero \(owned\.py:{line}\); "
    kept = r"the results of 2 generations are kept, and `swarmwright resume \S+ --accept-changed-code` conti"
    with pytest.raises(RunError, match=wanted + kept):
        optimize(experiment(), out=tmp_path / "run")
    outcome = Run.open(tmp_path / "run").sessions[-1].outcome
    assert outcome is not None
    assert outcome.startswith("Draw._tell: ZeroDivisionError")
    install()
    assert resume(tmp_path / "run", accept_changed_code=True).generations == 4


def test_a_ranking_that_raises_keeps_what_was_computed(install: Install, tmp_path: Path) -> None:
    score = "        return np.array([sum(row) for row in episodes])"
    calls = "        self.calls = getattr(self, 'calls', 0) + 1\n"
    experiment = install(score, f"{calls}        1 / (3 - self.calls)\n{score}")
    kept = r"the results of 2 generations are kept, and `swarmwright resume \S+ --accept-changed-code` conti"
    with pytest.raises(PlugInError, match=rf"^Mean\._score: ZeroDivisionError: .*; {kept}"):
        optimize(experiment(), out=tmp_path / "run")
    experiment = install(score, f"{calls}        return [] if self.calls > 2 else [0.0] * len(episodes)")
    with pytest.raises(PlugInError, match=rf"^Mean\._score .*; {kept}"):
        optimize(experiment(), out=tmp_path / "other")


OTHERS = ("return self.initials(range(4))", "return self.initials(range(3))")
RANDOM = (
    "return self.initials(range(4))",
    "return np.random.default_rng().random((4, self.representation.genome_size))",
)


def test_edited_code_is_named_before_what_follows_from_it(install: Install, tmp_path: Path) -> None:
    run = optimize(install()(), lambda one: one.generation < 1, out=tmp_path / "run")
    install(*OTHERS)
    with pytest.raises(
        InputError, match=r"method draw has changed since .*owned\.py was edited(.|\n)*-.*range\(4"
    ):
        resume(run)
    with pytest.raises(RunError, match="generation 0 is not reproducible here, since the code") as caught:
        resume(run, accept_changed_code=True)
    assert "has changed: owned.py was edited. Restore the original code" in str(caught.value)
    assert str(caught.value).endswith("start a new run; the results of 2 generations are kept")
    assert list(Run.open(run.path).code) == [1], "what did not fit is not kept"
    install()
    assert resume(run).generations == 4


@pytest.mark.parametrize("operation", ["generational", "steady_state"])
def test_a_method_that_is_not_deterministic(operation: str, install: Install, tmp_path: Path) -> None:
    old, new = RANDOM
    if operation == "steady_state":
        old, new = "self.initial_of(index)", "self.initial_of(index) * np.random.default_rng().random()"
    experiment = install(old, new, operation=operation, in_flight=2)
    run = optimize(experiment(), lambda one: one.generation < 1, out=tmp_path / "run")
    with pytest.raises(RunError, match="generation 0 is not reproducible here: the method draw") as caught:
        resume(run)
    assert "find the cause with `swarmwright.testing.check_method('draw')`" in str(caught.value)
    assert "swarmwright resume" not in str(caught.value)
    assert "numpy" not in str(caught.value)


def test_versions_that_differ_are_named_and_no_others(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = optimize(install(*RANDOM)(), lambda _: False, out=tmp_path / "run")
    recorded = run.sessions[0].versions
    monkeypatch.setattr(
        "swarmwright.runs.optimization.resuming.versions",
        lambda _: {**recorded, "numpy": "0.1", "sqlite": "2"},
    )
    with pytest.raises(RunError) as caught:
        resume(run)
    assert f"The run began with numpy {recorded['numpy']} (now 0.1); use these" in str(caught.value)


def test_a_finished_run_does_not_need_its_method(install: Install, tmp_path: Path) -> None:
    run = optimize(install()(), out=tmp_path / "run")
    install(*OTHERS)
    assert resume(run).digest == run.digest
    with pytest.raises(InputError, match="method draw has changed"):
        resume(run, generations=5)


def test_the_command_line_says_it_without_a_traceback(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install("return self.initials(range(4))", "raise KeyError('gain')")
    assert swarmwright(["optimize", "owned.yaml", "--out", str(tmp_path / "run")]) == 1
    found = capsys.readouterr().err
    assert re.match(r"swarmwright: Draw\._ask: KeyError: 'gain' \(owned\.py:\d+\)\n", found)
    # Also what is raised before a run begins.
    install("    steady_state = True\n", "    @classmethod\n    def missing(cls):\n        cls.nothing()\n")
    assert swarmwright(["optimize", "owned.yaml", "--out", str(tmp_path / "run-2")]) == 1
    found = capsys.readouterr().err
    assert "swarmwright: Draw.missing: AttributeError: type object 'Draw' has no attribute" in found


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("return self.initials(range(4))", "return None", r"Draw\._ask \(owned\.py:\d+\): returned nothing"),
        ("self.initials(range(4))", "self.initials(range(4))[0]", r"Draw\._ask .*the shape \(\d+,\); expec"),
        ("self.initials(range(4))", "self.initials(range(0))", r"Draw\._ask .*numbers with the shape \(0, "),
        ("self.initials(range(4))", "self.initials(range(4)) * np.nan", r"Draw\._ask .*nan at \[0, 0\]"),
        ("self.initials(range(4))", "[['a']]", r"Draw\._ask .*a list of <U1 instead of numbers"),
        ("return self._scores", "return 'good'", r"Draw\.population_fitness \(owned\.py:\d+\): ret"),
        ("return self._scores", "return self._scores[:0]", r"Draw\.population_fitness .*the shape \(0,\); "),
        ("return self._scores", "return -np.inf * self._scores",
         r"Draw\.population_fitness \(owned\.py:\d+\): returned an infinite fitness; use NaN for"),
        ("return 4 *", "return 'x' *", r"Draw\.budget \(owned\.py:\d+\): is 'xxxx', expected .*integer"),
        ("super().initial(stream)", "[1, 2]", r"Net\.initial \(owned\.py:\d+\): .*the shape \(2,\)"),
        ("super().initial(stream)", "self.bias", r"Net\.initial: AttributeError: .*\(owned\.py:\d+\)"),
        ("def initial(", "def weights(self, genomes):\n        return genomes[:2]\n\n    def initial(",
         r"Net\.weights .*the shape \(2, \d+\); expected weights"),
        ("def initial(", "def architecture(self):\n        return 5\n\n    def initial(",
         r"Net\.architecture .*returned a int; expected a dict"),
        ("def initial(", "@property\n    def bounds(self):\n        return -1, 1\n\n    def initial(",
         r"Net\.bounds .*returned numbers with the shape \(\)"),
        ("[sum(row) for row in episodes]", "[1.0]", r"Mean\._score .*the shape \(1,\); .*shape \(4,\)"),
        ("sum(row) for row", "row for row", r"Mean\._score .*the shape \(4, 1\)"),
        ("np.array([sum(row) for row in episodes])", "None", r"Mean\._score .*returned nothing \(None\)"),
        ("def _score(", "def seeds(self, first, generation=0):\n        return first\n\n    def _score(",
         r"Mean\.seeds \(owned\.py:\d+\): returned 0; expected a list"),
        ("_scores = np.empty(0)\n", "def __init__(self, options, *_, seed):\n        self.seed = seed\n",
         r"Draw\.__init__ .*does not call super\(\)"),
    ],
)  # fmt: skip
def test_what_is_returned_is_checked(
    old: str, new: str, words: str, install: Install, tmp_path: Path
) -> None:
    with pytest.raises(RunError, match=words):
        optimize(install(old, new)(), out=tmp_path / "run")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "return self.initial_of(index)",
            "return self.initial_of(index)[:3]",
            r"Draw\._ask_next .*shape \(3,\)",
        ),
        ("generation_size = 4", "generation_size = 0", r"Draw\.generation_size: is 0, expected .*integer"),
        (
            "np.array([fitness])",
            "[1] / 2",
            r"Draw\._tell_next: TypeError: unsupported operand .*\(owned\.py:\d+\)",
        ),
    ],
)
def test_the_same_in_steady_state(old: str, new: str, words: str, install: Install, tmp_path: Path) -> None:
    with pytest.raises(RunError, match=words):
        optimize(install(old, new, operation="steady_state", in_flight=2)(), out=tmp_path / "run")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("def _ask(", "def ask_(", r"method 'draw' \(owned:Draw, .*\): lacks _ask$"),
        ("    options_model = DrawOptions\n", "", r"method 'draw' \(owned:Draw, .*\): lacks options_model$"),
    ],
)
def test_what_a_class_lacks(old: str, new: str, words: str, install: Install) -> None:
    with pytest.raises(InputError, match=words):
        install(old, new)()
