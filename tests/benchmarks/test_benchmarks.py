"""The benchmarks run, and what they write has the form that scripts rely on."""

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import suite
from benchmarks.__main__ import main
from benchmarks.measurement import Samples
from benchmarks.suite import NotBuiltError, Scale
from tests.cpp import build
from tests.java import jar

KEYS = {"name", "value", "unit", "against", "ratio"}


@pytest.mark.timeout(1500)  # it may build the wrappers for Java and C++, and what measures in Rust
@pytest.mark.skipif(shutil.which("cargo") is None, reason="the bare client is compiled by cargo")
def test_a_quick_run_compares_every_figure_with_its_floor(root: Path, tmp_path: Path) -> None:
    from benchmarks import bare
    from benchmarks.bound import build as build_measurements
    from benchmarks.wrappers import COLUMNS

    jar()
    build()
    bare.build()
    build_measurements()
    file = tmp_path / "build" / "bench.json"
    result = subprocess.run(
        [sys.executable, "-m", "benchmarks", str(file), "--quick"],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=170,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    measurements = json.loads(file.read_text())
    names = [one["name"] for one in measurements]
    assert len(set(names)) == len(names)
    for one in measurements:
        assert set(one) == KEYS
        assert math.isfinite(one["value"])
        assert one["unit"]
        assert (one["against"] is None) == (one["ratio"] is None)
        assert one["against"] is None or one["against"] in names
    by_name = {one["name"]: one for one in measurements}
    for broker in ("embedded", "Mosquitto"):
        step = by_name[f"step round trip ({broker})"]
        floor = by_name[f"bare ping-pong ({broker})"]
        # With one repetition the ratio is that of the two values.
        assert step["ratio"] == pytest.approx(step["value"] / floor["value"])
        for agents in ("1 agent", "10 agents", "100 agents"):
            ours = by_name[f"stepwise, 8 servers, {agents} each ({broker})"]
            assert ours["against"] == f"bare messages, 8 servers, {agents} each ({broker})"
            assert ours["value"] > 0
    for name in ("Minisim", "Emergency Exit"):
        bound = by_name[f"{name}, counted bound, all units at once"]
        # Nothing is faster than what the processor can do, and nothing here is a thousand times slower.
        assert 0.001 < bound["ratio"] < 1
    assert by_name["offloaded, one evaluation there and back"]["value"] > 0
    for row in ("Python", "numpy", "Java", "C++"):
        for measured in COLUMNS:
            one = by_name[f"Minisim, {row}: {measured}"]
            assert one["against"] == f"Minisim, Rust (built in): {measured}"
    for row in ("Gymnasium, CartPole", "MuJoCo, 4 rovers, 50 steps"):
        assert all(by_name[f"{row}: {measured}"]["against"] is None for measured in COLUMNS)
        assert row in result.stdout
    for word in ("ratio", "aim", "<= 1.5", ">= 0.8", str(file)):
        assert word in result.stdout, result.stdout


def test_a_repetition_is_compared_with_its_own_floor() -> None:
    from benchmarks.measurement import Samples

    floor = Samples("floor", "us", values=[10.0, 20.0, 30.0])
    ours = Samples("ours", "us", floor, values=[20.0, 20.0, 90.0])
    measurement = ours.measurement()
    assert measurement.value == 20.0
    assert measurement.ratio == 2.0  # the median of 2, 1 and 3, not 20 / 20


def test_the_bound_is_that_of_the_busiest_unit() -> None:
    from benchmarks.bound import Count, bounds

    rates = {"multiply_add": 10.0, "divide": 1.0, "square_root": 0.5, "scalar_load": 8.0, "scalar_store": 4.0}
    # The divider is busy for 2 + 2 / 0.5 ns; half the lanes load half as often.
    count = Count(vector=6, divide=2, square_root=2, scalar_load=51)
    at_once, in_turn = bounds(count, rates, 8)
    assert at_once == pytest.approx(6.0)
    assert in_turn == pytest.approx(0.6 + 6.0 + 51 / 2 / 8)


def test_an_unknown_suite_is_refused_with_those_that_there_are() -> None:
    from benchmarks.suite import QUICK, SUITES, run

    with pytest.raises(SystemExit) as refused:
        next(run(QUICK, "rolouts"))
    for name in SUITES:
        assert name in str(refused.value)


class _Sound:
    def repeat(self) -> None:
        pass

    def samples(self) -> list[Samples]:
        return [Samples("speed", "m/s", values=[2.0])]

    def close(self) -> None:
        pass


def _absent(_scale: Scale) -> _Sound:
    raise NotBuiltError("the simulator is missing; `make simulator` builds it")


def _ends(_scale: Scale) -> _Sound:
    raise SystemExit("the other program ended")


def _fails(_scale: Scale) -> _Sound:
    raise ValueError("no figure")


def test_what_was_measured_is_kept_when_another_suite_cannot_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bench.json"
    monkeypatch.setattr(sys, "argv", ["benchmarks", str(file)])
    suites = {"absent": _absent, "sound": lambda _scale: _Sound()}
    monkeypatch.setattr(suite, "SUITES", suites)
    main()
    assert [one["value"] for one in json.loads(file.read_text())] == [2.0]
    assert "not measured: absent: the simulator is missing; `make simulator`" in capsys.readouterr().out
    file.unlink()
    monkeypatch.setattr(suite, "SUITES", {"ends": _ends, "fails": _fails, **suites})
    with pytest.raises(SystemExit, match="failed: ends, fails"):
        main()
    assert [one["value"] for one in json.loads(file.read_text())] == [2.0]
    said = capsys.readouterr().err
    assert "ends: the other program ended" in said
    assert "ValueError: no figure" in said
    monkeypatch.setattr(suite, "SUITES", {"absent": _absent})
    with pytest.raises(SystemExit, match="nothing was measured"):
        main()
