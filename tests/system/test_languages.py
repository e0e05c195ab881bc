"""One experiment over servers in four languages at once: the record of one of them alone, byte for byte."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.python.simulations import minisim
from tests.system.brokers import BrokerProcess
from tests.system.conftest import EXPERIMENT, Experiment, Launch, Serve, ServeCpp, ServeJava
from tests.system.runs import attempts, record

pytestmark = pytest.mark.timeout(600)  # the first of them builds the wrappers


@pytest.fixture
def python_minisim(tmp_path: Path) -> Path:
    """The simulation in Python, under the title of the others."""
    source = Path(minisim.__file__).read_text(encoding="utf-8")
    assert 'title = "minisim in Python"' in source
    path = tmp_path / "python_minisim.py"
    path.write_text(source.replace('title = "minisim in Python"', 'title = "minisim"'), encoding="utf-8")
    return path


@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_one_experiment_over_four_languages(
    embedded: BrokerProcess,
    serve: Serve,
    serve_java: ServeJava,
    serve_cpp: ServeCpp,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
    python_minisim: Path,
    mode: str,
) -> None:
    serve(embedded.url, first=1)
    serve_java(embedded.url, server=2)
    serve_cpp(embedded.url, server=3)
    launch("serve", f"{python_minisim}:Minisim", "--broker", embedded.url, "--id", 4, "--json").until_event(
        "ready", server=4
    )
    path = experiment(f"{EXPERIMENT}mode: {mode}\n")
    program = launch("optimize", path, "--broker", embedded.url, "--out", "together")
    assert program.wait() == 0, program.stderr
    assert record(path.parent / "together") == expected
    used = {entry["server"] for entry in attempts(path.parent / "together")}
    assert used == {1, 2, 3, 4} if mode == "stepwise" else used <= {1, 2, 3, 4}


def test_each_alone_gives_the_same_record(
    embedded: BrokerProcess,
    serve: Serve,
    serve_java: ServeJava,
    serve_cpp: ServeCpp,
    launch: Launch,
    experiment: Experiment,
    expected: dict[str, Any],
    python_minisim: Path,
) -> None:
    """Under prefixes of their own, so that none takes part in what is another's."""
    servers: dict[str, Callable[..., object]] = {
        "rust": lambda *options: serve(embedded.url, *options),
        "java": lambda *options: serve_java(embedded.url, *options),
        "cpp": lambda *options: serve_cpp(embedded.url, *options),
        "python": lambda *options: launch(
            "serve", f"{python_minisim}:Minisim", "--broker", embedded.url, "--json", *options
        ).until_event("ready"),
    }
    for language, start in servers.items():
        start("--prefix", language)
        path = experiment(f"{EXPERIMENT}prefix: {language}\n")
        program = launch("optimize", path, "--broker", embedded.url, "--out", language)
        assert program.wait() == 0, program.stderr
        assert record(path.parent / language) == expected, language
