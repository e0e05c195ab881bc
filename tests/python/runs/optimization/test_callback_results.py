"""Callbacks that are asynchronous, return something else than they may, or fail."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Generation, InputError, Run, callbacks, optimize, resume
from tests.python.records import EXPERIMENT

HERE = EXPERIMENT.replace(servers="in-process")


async def asynchronous(_: Generation) -> bool:
    return False


class Asynchronous:
    async def __call__(self, _: Generation) -> bool:
        return False


async def progress(_done: int, _total: int, _waiting_for: str) -> None:
    pass


def test_asynchronous_callbacks_are_refused(tmp_path: Path) -> None:
    for callback in (asynchronous, Asynchronous()):
        wrong: Any = callback
        words = r"synchronous is asynchronous \(async def\), and would not be awaited$"
        with pytest.raises(InputError, match=f"^on_generation: must be a function .*{words}"):
            optimize(HERE, wrong, out=tmp_path / "run")
    wrong = progress
    with pytest.raises(InputError, match=r"^on_progress: .*; progress is asynchronous"):
        optimize(HERE, on_progress=wrong, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


class Unprintable:
    """As some proxies of other libraries."""

    def __repr__(self) -> str:
        raise ValueError("not available")


@pytest.mark.parametrize(
    ("returned", "words"),
    [
        ("x" * 100_000, f"'{'x' * 56}..."),
        (np.zeros((1000, 1000)), "an object of the class ndarray"),
        (Unprintable(), "an object of the class Unprintable"),
        ([Unprintable()], "an object of the class list"),
        (10**5000, "an object of the class int"),
    ],
    ids=["long", "array", "unprintable", "list", "digits"],
)
def test_anything_that_a_callback_returns_is_named_shortly(returned: Any, words: str, tmp_path: Path) -> None:
    words = f"on_generation: returned {words}; return False to end the run, True or None to continue"
    with pytest.raises(InputError, match=f"^{re.escape(words)}$"):
        optimize(HERE, lambda _: returned, out=tmp_path / "run")
    assert Run.open(tmp_path / "run").sessions[-1].outcome == words


@pytest.mark.parametrize("returned", [0, 1, "no", 0.0, []])
def test_what_a_callback_returns_is_checked(returned: Any, tmp_path: Path) -> None:
    words = f"on_generation: returned {returned!r}; return False to end the run, True or None to continue"
    with pytest.raises(InputError, match=f"^{re.escape(words)}$"):
        optimize(HERE, lambda _: returned, out=tmp_path / "run")
    run = Run.open(tmp_path / "run")
    assert (run.generations, run.state, run.sessions[-1].outcome) == (1, "failed", words)
    both = callbacks.together(lambda _: None, lambda _: returned)
    with pytest.raises(InputError, match=re.escape(words)):
        resume(run, both)


def test_a_coroutine_that_a_callback_returns_is_closed(tmp_path: Path) -> None:
    wrong: Any = lambda generation: asynchronous(generation)  # noqa: E731, PLW0108 - no coroutine function
    with pytest.raises(InputError, match=r"^on_generation: returned a coroutine, asynchronous, which would"):
        optimize(HERE, wrong, out=tmp_path / "run")


@pytest.mark.parametrize(("returned", "state"), [(np.bool_(False), "stopped"), (np.bool_(True), "done")])
def test_truth_values_of_numpy_are_taken(returned: Any, state: str, tmp_path: Path) -> None:
    assert optimize(HERE, lambda _: returned, out=tmp_path / "run").state == state


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (KeyError("x"), "KeyError: 'x'"),
        (ValueError("mine\nand more"), "ValueError: mine\\nand more"),
        (SystemExit(3), "SystemExit: 3"),
        (RuntimeError(), "RuntimeError"),
    ],
)
def test_the_outcome_of_a_run_names_the_exception_of_a_callback_and_its_line(
    error: BaseException, words: str, tmp_path: Path
) -> None:
    def fail(_: Generation) -> None:
        raise error

    with pytest.raises(type(error)) as raised:
        optimize(HERE, fail, out=tmp_path / "run")
    assert raised.value is error
    run = Run.open(tmp_path / "run")
    line = fail.__code__.co_firstlineno + 1
    found = run.sessions[-1].outcome or ""
    assert found.startswith(f"{words} (")
    code = "" if str(error) else ": raise error"
    assert found.endswith(f"test_callback_results.py:{line}{code})")
    assert run.state == "failed"
