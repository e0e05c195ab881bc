import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.container import ErrorbarContainer
from PIL import Image

from swarmwright import Experiment, compare, optimize
from swarmwright.display.figures.run import draw, fitness
from swarmwright.display.figures.style import save
from swarmwright.runs.diversity import diversity
from tests.python.analysis.runs import KnownRun

NAN = math.nan


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        [[1.0, 2.0, 3.0]],
        [[1.0]],
        [[NAN, NAN], [NAN, NAN]],
        [[NAN, 1.0], [NAN, NAN], [2.0, 3.0]],
        [[-1e300, 1e300], [1e300, -1e-300]],
        [[-1e-300, 0.0], [0.0, 0.0]],
        [[0.0, 0.0]] * 300,
    ],
    ids=["one generation", "one candidate", "all failed", "some failed", "huge", "tiny", "flat"],
)
@pytest.mark.parametrize("x", ["evaluations", "generations"])
def test_any_run_can_be_drawn(tmp_path: Path, values: list[list[float]], x: str) -> None:
    run = KnownRun(tmp_path, values)
    save(draw(run, diversity(run), x=x), tmp_path / "x.png")
    with Image.open(tmp_path / "x.png") as picture:
        assert picture.size == (1080, 792)
        assert (np.asarray(picture.convert("L")) < 200).mean() > 0.005


def test_the_lines_are_those_of_the_run(tmp_path: Path) -> None:
    run = KnownRun(tmp_path, [[0.0, 4.0], [1.0, 2.0], [3.0, 9.0]])
    upper, _ = draw(run, diversity(run)).axes
    lines = {line.get_label(): line for line in upper.lines}
    assert np.asarray(lines["best so far"].get_ydata()).tolist() == [4, 4, 9]
    assert np.asarray(lines["best of the population"].get_ydata()).tolist() == [4, 2, 9]
    assert np.asarray(lines["mean"].get_ydata()).tolist() == [2, 1.5, 6]
    assert np.asarray(lines["mean"].get_xdata()).tolist() == [2, 4, 6]
    assert any(text.get_text() == "9" for text in upper.texts)


def test_the_mean_is_on_the_axis_or_a_note_says_how_low_it_is(tmp_path: Path) -> None:
    # Most candidates are good, a few are poor: the mean is below the middle half.
    near = KnownRun(tmp_path, [[9.0, 9.5, 10.0, 10.5, 6.0]] * 30)
    (axes,) = fitness(near).axes
    assert axes.get_ylim()[0] < 9.0
    assert not [text for text in axes.texts if "reaches down" in text.get_text()]
    far = KnownRun(tmp_path, [[9.0, 9.5, 10.0, 10.5, -1e6]] * 30)
    (axes,) = fitness(far).axes
    assert axes.get_ylim()[0] > 5
    assert [text.get_text() for text in axes.texts if "mean" in text.get_text()] == [
        "↓ the mean reaches down to −2e+05"
    ]
    # Only at the beginning: the cut says so.
    first = KnownRun(tmp_path, [[9.0, 9.5, 10.0, 10.5, -1e6]] + [[9.0, 9.5, 10.0, 10.5, 9.0]] * 30)
    (axes,) = fitness(first).axes
    assert [text.get_text() for text in axes.texts if "reaches" in text.get_text()] == [
        "↓ the beginning reaches down to −2e+05"
    ]


def test_titles_name_the_mission(tmp_path: Path) -> None:
    arena = {"simulation": "arena", "sensors": 24, "actuators": 2}
    place = {"walls": {"rectangle": [4, 3]}, "start": {"disc": {"radius": 1}}}
    for mission, subject in (
        ("foraging", "arena, Foraging"),
        ({"title": "Meet", "fitness": "order", **place}, "arena, Meet"),
    ):
        run = KnownRun(tmp_path, [[1.0, 2.0]], **arena, parameters={"mission": mission})
        for figure in (fitness(run), draw(run, diversity(run)), compare([run]).figure()):
            assert figure.get_suptitle().startswith(f"{subject}: ")
    run = KnownRun(tmp_path, [[1.0, 2.0]])
    assert fitness(run).get_suptitle().startswith("minisim: ")


def test_all_that_the_legend_names_of_one_generation_is_drawn(tmp_path: Path) -> None:
    run = KnownRun(tmp_path, [[1.0, 2.0, 3.0, 4.0]])
    upper, lower = draw(run, diversity(run)).axes
    (half,) = (one for one in upper.collections if one.get_label() == "middle half of the population")
    assert isinstance(half, LineCollection)
    ((low, high),) = half.get_segments()
    assert (low[1], high[1]) == (1.75, 3.25)
    assert lower.get_xticks().tolist() == [4]


def test_fitness_that_hardly_changes_has_digits_enough(tmp_path: Path) -> None:
    run = KnownRun(tmp_path, [[1000 - 3e-10, 1000 - 4e-10], [1000 - 2e-10, 1000 - 3e-10]])
    figure = draw(run, diversity(run))
    figure.draw_without_rendering()
    upper = figure.axes[0]
    assert upper.yaxis.get_offset_text().get_text() == ""
    labels = [label.get_text() for label in upper.get_yticklabels()]
    assert len(set(labels)) == len(labels)
    shown = [float(text) for text in labels]
    np.testing.assert_allclose(shown, upper.get_yticks(), rtol=0, atol=1e-12)
    assert any(text.get_text().startswith("999.9999999998") for text in upper.texts)


@pytest.mark.parametrize(
    ("changes", "label"),
    [
        ({"ranking": {"kind": "absolute", "reevaluate": True}}, "(re-evaluated)"),
        ({"method": {"kind": "racing", "evaluations": 100}}, "(most instances)"),
    ],
)
def test_what_can_fall_is_not_called_the_best_so_far(
    tmp_path: Path, changes: dict[str, Any], label: str
) -> None:
    run = KnownRun(tmp_path, [[0.0, 4.0], [1.0, 2.0]], **changes)
    upper, _ = draw(run, diversity(run)).axes
    labels = [str(line.get_label()) for line in upper.lines]
    assert f"candidate that would be returned {label}" in labels
    assert "best so far" not in labels
    left, right = compare([run, run]).figure().axes
    assert left.get_ylabel() == "recorded fitness of the returned candidate\n(more is better)"
    assert right.get_ylabel().startswith("recorded fitness of the best of each run")


def test_one_is_not_called_several(tmp_path: Path) -> None:
    for values, words in (
        ([[1.0, 2.0]], "2 evaluations in 1 generation, seed 1"),
        ([[1.0], [2.0]], "2 evaluations in 2 generations, seed 1"),
        ([[1.0]], "1 evaluation in 1 generation, seed 1"),
    ):
        run = KnownRun(tmp_path, values)
        upper, _ = draw(run, diversity(run)).axes
        assert upper.get_title(loc="left") == words


BIG = """
from swarmwright import Simulation


class Big(Simulation):
    title, sensors, actuators = "big", 2, 2

    def reset(self, parameters, seed):
        self.result = None
        return [[0.1, 0.2]]

    def step(self, actions):
        self.result = 1.7e308 if actions[0][0] > 0 else -1.7e308 if actions[0][0] > -0.1 else 1.0
        return [[0.1, 0.2]]

    def done(self):
        return self.result is not None

    def fitness(self):
        return self.result
"""


@pytest.mark.slow
def test_huge_fitness_is_drawn(tmp_path: Path) -> None:
    (tmp_path / "big.py").write_text(BIG)
    values = {"simulation": f"{tmp_path}/big.py:Big", "controller": {"kind": "layered", "hidden": []}}
    experiment = Experiment.from_mapping(
        {**values, "servers": "in-process", "method": {"population": 8, "generations": 10}}
    )
    runs = [optimize(experiment, seed=seed, out=tmp_path / f"{seed}") for seed in (1, 2)]
    other = experiment.replace(method={"kind": "random_search"})
    runs.append(optimize(other, out=tmp_path / "other"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        runs[0].plot(tmp_path / "one.png")
        compare(runs).plot(tmp_path / "all.png")
    assert (tmp_path / "one.png").stat().st_size > 5000


@pytest.mark.parametrize("placement", ["random", "fixed"])
def test_the_best_on_held_out_seeds_is_drawn_where_seeds_matter(tmp_path: Path, placement: str) -> None:
    run = optimize(
        Experiment.from_mapping(
            {
                "simulation": "minisim",
                "parameters": {"placement": placement, "numAgents": 3},
                "method": {"kind": "cma_es", "population": 6, "generations": 4},
                "ranking": {"episodes": 2, "seeds": "new"},
                "validate": {"episodes": 12},
                "servers": "in-process",
            }
        ),
        out=tmp_path / "run",
    )
    upper, _ = draw(run, diversity(run)).axes
    labels = [str(one.get_label()) for one in upper.containers]
    assert labels == ["best on held-out seeds (12 episodes, 95 % interval)"] * (placement == "random")
    if labels:
        assert run.validation is not None
        best = run.validation.best.fitness
        (held_out,) = upper.containers
        assert isinstance(held_out, ErrorbarContainer)
        point, _, (bar,) = held_out.lines
        assert point is not None
        assert np.asarray(point.get_xydata()).tolist() == [[24, best.mean]]
        assert isinstance(bar, LineCollection)
        ends = bar.get_segments()[0][:, 1].tolist()
        assert ends == pytest.approx([best.low, best.high])
        low, high = upper.get_ylim()
        assert low < ends[0] < ends[1] < high
