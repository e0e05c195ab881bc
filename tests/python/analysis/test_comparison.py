import csv
import json
import math
import re
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import swarmwright
from swarmwright import Comparison, Experiment, Generation, InputError, Run, compare, optimize
from swarmwright.analysis.comparison import compare_all
from swarmwright.display.figures.comparison import _format_names
from swarmwright.display.figures.style import COLORS
from tests.python.analysis.runs import KnownRun, runs

SEARCH = {"kind": "random_search", "population": 4, "generations": 3}


def two(path: Path) -> list[KnownRun]:
    return [*runs(path, [5, 6, 7, 8, 9.0]), *runs(path, [1, 2, 3, 4, 5.0], method=SEARCH)]


def drawn(comparison: Comparison, path: Path) -> None:
    """Write the figure, and see that it is one and that nothing was complained of."""
    comparison.plot(path / "x.png")
    with Image.open(path / "x.png") as picture:
        assert picture.width >= 1000
        pixels = np.asarray(picture.convert("L"))
    assert (pixels < 200).mean() > 0.005


def test_two_groups(tmp_path: Path) -> None:
    found = compare(two(tmp_path))
    first, second = found.groups
    assert (first.label, first.median, first.quartiles) == ("nnga", 7.0, (6.0, 8.0))
    assert (second.label, second.median, second.evaluations) == ("random_search", 3.0, (4, 4))
    (pair,) = found.pairs
    assert pair.difference.u == 24.5
    assert pair.difference.effect == 0.98
    assert pair.difference.shift == 4.0
    assert pair.difference.p == pair.p_holm < 0.05
    assert found.kruskal is None
    assert found.notes == ()
    said = str(found)
    assert "nnga" in said
    assert "0.98  large" in said
    assert "Note" not in said
    drawn(found, tmp_path)


def test_notebooks_show_a_comparison_as_tables(tmp_path: Path) -> None:
    found = compare([*two(tmp_path), *runs(tmp_path, [0, 0, 0, 0, 0.0], method={"population": 9})])
    assert repr(found) == "<Comparison by fitness: 15 runs in 3 groups>"
    shown = found._repr_html_()
    assert shown.count("<tr>") == 1 + 3 + 1 + 1 + 3  # groups, Kruskal and Wallis, pairs
    for words in ("nnga, population 4", "random_search", "Kruskal-Wallis H", "p (Holm)", "large"):
        assert words in shown
    alone = compare(two(tmp_path)[:1])
    assert alone._repr_html_().count("<table>") >= 1
    assert repr(compare(two(tmp_path)[:5], by="fitness")) == "<Comparison by fitness: 5 runs in 1 groups>"


def test_more_groups_are_tested_together_and_by_pairs(tmp_path: Path) -> None:
    found = compare([*two(tmp_path), *runs(tmp_path, [0, 0, 0, 0, 0.0], method={"population": 9})])
    assert found.kruskal is not None
    assert found.kruskal.p < 0.01
    assert [(pair.first.label, pair.second.label) for pair in found.pairs] == [
        ("nnga, population 4", "random_search"),
        ("nnga, population 4", "nnga, population 9"),
        ("random_search", "nnga, population 9"),
    ]
    assert all(pair.p_holm >= pair.difference.p for pair in found.pairs)
    assert "Kruskal-Wallis" in str(found)
    drawn(found, tmp_path)


def test_many_groups_are_drawn_and_told_in_short(tmp_path: Path) -> None:
    groups = [
        run
        for size in range(4, 16)
        for run in runs(tmp_path, [size, size + 1.0], method={"population": size})
    ]
    found = compare(groups)
    assert len(found.pairs) == 66
    assert "and 51 pairs with larger p" in str(found)
    drawn(found, tmp_path)


@pytest.mark.slow
def test_methods_are_compared_within_a_task(tmp_path: Path) -> None:
    """Fitness of unlike tasks has unlike units, and pairs between these would weaken Holm's correction."""
    found = compare(
        [
            run
            for steps, scale in ((10, 1.0), (20, 1000.0))
            for size in (4, 6, 9)
            for run in runs(
                tmp_path,
                [scale * (size + part) for part in (0, 0.1, 0.2, 0.3, 0.4)],
                method={"population": size},
                parameters={"maxSteps": steps},
            )
        ]
    )
    assert [task.label for task in found.tasks] == ["maxSteps 10", "maxSteps 20"]
    assert [task.differs for task in found.tasks] == [
        {"parameters.maxSteps": 10},
        {"parameters.maxSteps": 20},
    ]
    assert [len(task.groups) for task in found.tasks] == [3, 3]
    assert sum((task.groups for task in found.tasks), ()) == found.groups
    assert found.kruskal is None
    assert all(task.kruskal is not None and task.kruskal.p < 0.01 for task in found.tasks)
    assert len(found.pairs) == 6
    for pair in found.pairs:
        assert pair.first.differs["parameters.maxSteps"] == pair.second.differs["parameters.maxSteps"]
        # Of three pairs of a task, not of 15 of all groups.
        assert pair.p_holm == pytest.approx(3 * pair.difference.p)
    assert found.notes == (
        "groups solve different tasks, and those of one task are tested against each other",
    )
    said = str(found)
    assert [line for line in said.splitlines() if line.startswith("Task")] == [
        "Task: maxSteps 10",
        "Task: maxSteps 20",
    ]
    assert said.count("All groups of the task: Kruskal-Wallis") == 2
    values = found.to_mapping()
    assert values["kruskal_wallis"] is None
    assert [task["groups"] for task in values["tasks"]] == [
        [one.label for one in task.groups] for task in found.tasks
    ]
    assert all(task["kruskal_wallis"]["p"] < 0.01 for task in values["tasks"])
    figure = found.figure()
    assert len(figure.axes) == 4
    assert [axes.get_title(loc="left") for axes in figure.axes[::2]] == ["maxSteps 10", "maxSteps 20"]
    assert figure.legends[0].get_title().get_text() == "line: median of the runs · shaded: middle half"
    figure.canvas.draw()
    for upper, lower in zip(figure.axes[:2], figure.axes[2:], strict=True):
        assert upper.yaxis.label.get_window_extent().y0 > lower.yaxis.label.get_window_extent().y1
        assert upper.yaxis.label.get_window_extent().height < upper.get_window_extent().height
    assert all("Kruskal-Wallis p" in axes.get_title(loc="left") for axes in figure.axes[1::2])
    drawn(found, tmp_path)


def test_a_group_that_is_alone_in_its_task_is_noted(tmp_path: Path) -> None:
    made = [
        run
        for size, steps, value in ((4, 10, 1.0), (9, 10, 2.0), (12, 20, 3.0))
        for run in runs(tmp_path, [value] * 5, method={"population": size}, parameters={"maxSteps": steps})
    ]
    found = compare(made)
    assert [len(task.groups) for task in found.tasks] == [2, 1]
    assert found.notes[-1] == (
        "maxSteps 20, population 12 is the only one of its task and is tested against no other; tasks differ "
        "in maxSteps"
    )
    more = runs(tmp_path, [4.0] * 5, method={"population": 12}, parameters={"speedAgents": 0.7})
    assert (
        compare([*made, *more])
        .notes[-1]
        .endswith(
            "are each the only one of their task and are tested against no other; tasks differ in maxSteps, "
            "speedAgents"
        )
    )


def test_a_design_has_one_colour_and_name_in_all_tasks_whatever_the_order_of_runs(tmp_path: Path) -> None:
    made = [
        run
        for steps in (10, 20)
        for size in (4, 10)
        for run in runs(
            tmp_path,
            [size + part / 4 for part in range(4)],
            method={"population": size},
            parameters={"maxSteps": steps},
        )
    ]
    drawn = []
    for given in (made, made[::-1], [*made[4:12], *made[:4], *made[12:]]):
        figure = compare(given).figure()
        (legend,) = figure.legends
        shown = {
            text.get_text(): line.get_color()
            for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)
        }
        assert list(shown) == ["population 10 (4 runs)", "population 4 (4 runs)"]
        for axes in figure.axes[::2]:
            lines = {f"{line.get_label()} (4 runs)": line.get_color() for line in axes.get_lines()}
            assert shown.items() <= lines.items()
        titles = [axes.get_title(loc="left") for axes in figure.axes[::2]]
        names = [[one.get_text() for one in axes.get_xticklabels()] for axes in figure.axes[1::2]]
        verdicts = [axes.get_title(loc="left") for axes in figure.axes[1::2]]
        drawn.append((shown, titles, names, verdicts))
    assert drawn[0] == drawn[1] == drawn[2]
    assert drawn[0][1:3] == (["maxSteps 10", "maxSteps 20"], [["population 10", "population 4"]] * 2)
    assert all("A12 1.00" in one for one in drawn[0][3])
    # Colours are those of names, so that a design has one in figures of other runs too.
    assert drawn[0][0]["population 4 (4 runs)"] == COLORS[0]


def test_tables_and_figures_have_one_order(tmp_path: Path) -> None:
    made = [
        run
        for size, best in ((4, 2.0), (6, 9.0), (8, 1.0), (9, 9.0))
        for run in runs(tmp_path, [best, best + 0.5], method={"population": size})
    ]
    for order, sizes in (
        ("rank", "6948"),  # equals by name
        ("name", "4689"),
        ("given", "9864"),
        (["population 8", "population 4"], "8469"),
    ):
        found = compare(made[::-1], order=order)
        labels = [f"population {size}" for size in sizes]
        assert [one.label for one in found.groups] == labels
        assert [line.split("  ")[0] for line in str(found).splitlines()[1:5]] == labels
        boxes = found.figure().axes[1]
        assert [one.get_text() for one in boxes.get_xticklabels()] == labels
        pairs = [(pair.first.label, pair.second.label) for pair in found.pairs]
        assert pairs == list(combinations(labels, 2))
    with pytest.raises(InputError, match=r"^order: there is no group 'population 5'; there are 'population"):
        compare(made, order=["population 5"])
    wrong: Any = "size"
    with pytest.raises(InputError, match=r"^order: must be one of rank, name, given, or a list of labels"):
        compare(made, order=wrong)


def test_groups_tasks_and_designs_can_be_called_otherwise(tmp_path: Path) -> None:
    made = [
        run
        for steps in (10, 20)
        for size in (4, 6)
        for run in runs(
            tmp_path, [size, size + 1.0], method={"population": size}, parameters={"maxSteps": steps}
        )
    ]
    one_task = compare(made[:4], labels={"population 4": "few"})
    assert "few" in str(one_task)
    assert "population 4" not in str(one_task)
    assert {pair.second.label for pair in one_task.pairs} == {"few"}
    names = {"maxSteps 10": "short", "population 4": "few", "maxSteps 10, population 6": "one of them"}
    found = compare(made, labels=names)
    assert [task.label for task in found.tasks] == ["short", "maxSteps 20"]
    assert found.groups[0].label == "one of them"
    assert [one.get_text() for one in found.figure().legends[0].get_texts()] == [
        "population 6 (2 runs)", "few (2 runs)",
    ]  # fmt: skip
    with pytest.raises(InputError, match=r"^labels: there is no 'population 5' to be called otherwise;"):
        compare(made, labels={"population 5": "x"})
    with pytest.raises(InputError, match=r"^labels: two groups would be called 'population 6'"):
        compare(made[:4], labels={"population 4": "population 6"})


def test_names_of_boxes_leave_out_sensors_that_follow_from_the_robot_and_do_not_overlap(
    tmp_path: Path,
) -> None:
    arena = {"simulation": "arena", "ranking": {"episodes": 1}, "servers": "local"}
    small = {"kind": "random_search", "population": 2, "generations": 1}
    made = [
        optimize(
            Experiment.from_mapping(
                {**arena, "method": small, "parameters": {"robot": robot, "robots": 2, "duration": 1}}
            ),
            out=tmp_path / robot,
        )
        for robot in ("e-puck-rm1.2", "e-puck-rm1.1")
    ]
    figure = compare(made).figure()
    figure.draw_without_rendering()
    labels = figure.axes[1].get_xticklabels()
    names = [one.get_text().replace("\n", " ") for one in labels]
    assert names == ["robot e-puck-rm1.1", "robot e-puck-rm1.2"]
    first, second = (one.get_window_extent() for one in labels)
    assert first.x1 < second.x0


def climbing(final: float) -> list[list[float]]:
    """A run whose first candidates are far worse than all later ones."""
    return [[-1000.0 / 4**number + final, -2000.0 / 4**number] for number in range(40)]


def test_the_boxes_have_names_and_the_curves_are_not_squashed(tmp_path: Path) -> None:
    several = [
        KnownRun(tmp_path / f"{size}-{seed}", climbing(size), seed=seed, method={"population": size})
        for size in (4, 9)
        for seed in range(5)
    ]
    figure = compare(several).figure()
    curves, boxes = figure.axes
    assert [text.get_text() for text in boxes.get_xticklabels()] == ["population 9", "population 4"]
    bottom, top = curves.get_ylim()
    assert -300 < bottom < 0
    assert 9 < top < 100
    assert any("the beginning reaches down to −996" in text.get_text() for text in curves.texts)
    even = compare(runs(tmp_path, [5, 6, 7, 8, 9.0])).figure().axes[0]
    assert not [text for text in even.texts if "reaches down" in text.get_text()]
    assert even.get_ylim()[0] < 3


@pytest.mark.parametrize(("x", "place"), [("evaluations", 2), ("generations", 0)])
def test_one_generation_has_one_number(tmp_path: Path, x: Any, place: int) -> None:
    several = [KnownRun(tmp_path / str(seed), [[1.0, seed]], seed=seed) for seed in range(3)]
    curves, _ = compare(several).figure(x=x).axes
    assert curves.get_xticks().tolist() == [place]


def test_names_of_many_groups_are_slanted_and_whole_lists_stay_together(tmp_path: Path) -> None:
    groups = [
        run
        for size in range(4, 14)
        for run in runs(tmp_path, [size], method={"population": size}, controller={"hidden": [size, 2]})
    ]
    ticks = compare(groups).figure().axes[1].get_xticklabels()
    assert [text.get_text() for text in ticks][:1] == ["hidden [13, 2], population 13"]
    assert {text.get_rotation() for text in ticks} == {40.0}
    (first, *_) = compare(groups[:2], order="name").figure().axes[1].get_xticklabels()
    assert first.get_text() == "hidden [4, 2]\npopulation 4"


def test_slanted_names_are_below_the_last_task_where_all_have_the_same(tmp_path: Path) -> None:
    def names(sizes: dict[int, range]) -> list[list[str]]:
        found = compare(
            [
                run
                for steps, some in sizes.items()
                for size in some
                for run in runs(
                    tmp_path,
                    [size],
                    method={"population": size},
                    controller={"hidden": [size, 2]},
                    parameters={"maxSteps": steps},
                )
            ]
        )
        return [[one.get_text() for one in axes.get_xticklabels()] for axes in found.figure().axes[1::2]]

    upper, lower = names({10: range(4, 14), 20: range(4, 14)})
    assert (set(upper), lower[-1]) == ({""}, "hidden [4, 2], population 4")
    upper, lower = names({10: range(4, 14), 20: range(5, 15)})
    assert (upper[-1], lower[-1]) == ("hidden [4, 2], population 4", "hidden [5, 2], population 5")


def test_titles_of_tasks_begin_with_what_tells_them_apart(tmp_path: Path) -> None:
    """Titles are cut; another simulation's parameters tell nothing."""
    foreign = {"simulation": "theirs", "sensors": 2, "actuators": 1, "servers": "auto"}
    made = [
        run
        for mode in ("huge", "tiny")
        for size in (4, 9)
        for run in runs(tmp_path, [1.0], **foreign, parameters={"mode": mode}, method={"population": size})
    ]
    made += [run for size in (4, 9) for run in runs(tmp_path, [1.0], method={"population": size})]
    titles = [axes.get_title(loc="left") for axes in compare(made).figure().axes[::2]]
    assert sorted(titles) == ["minisim", "theirs, mode huge", "theirs, mode tiny"]


def test_names_of_boxes_are_broken_at_points_and_numbered_groups_are_in_order(tmp_path: Path) -> None:
    lines = _format_names(["method.measures.speed.range [0, 0.12]"]).names[0].split("\n")
    assert lines == ["method.measures.", "speed.range [0,", "0.12]"]
    groups = [
        run
        for size in (9, 4)
        for run in runs(
            tmp_path,
            [size],
            method={
                "population": size, "partners": size, "severity": size / 10, "probability": size / 10,
                "exchange_interval": size,
            },
            controller={"hidden": [size] * 20, "weight_range": float(size), "bias_range": float(size)},
        )
    ]  # fmt: skip
    boxes = compare(groups).figure().axes[1::2]
    assert [one.get_text().split(":")[0] for axes in boxes for one in axes.get_xticklabels()] == [
        "group 1", "group 2",
    ]  # fmt: skip


def test_few_runs_are_said_to_be_few(tmp_path: Path) -> None:
    found = compare([*runs(tmp_path, [1.0, 2.0, 3.0]), *runs(tmp_path, [1.0], method=SEARCH)])
    assert found.notes == (
        "with fewer than 5 runs in a group (nnga: 3; random_search: 1) a test has little power",
    )
    assert "none, too few runs" in str(found)
    assert found.figure().axes[1].get_title(loc="left") == "too few runs for a test"
    drawn(found, tmp_path)


def test_all_groups_together_can_be_tested_where_the_runs_of_a_pair_are_too_few(tmp_path: Path) -> None:
    strong = {**SEARCH, "generations": 4}
    found = compare(
        [
            *runs(tmp_path / "a", [1.0, 2.0, 3.0]),
            *runs(tmp_path / "b", [4.0, 5.0, 6.0], method=SEARCH),
            *runs(tmp_path / "c", [7.0, 8.0, 9.0], method=strong),
        ]
    )
    assert "none, too few runs" in str(found)
    assert "All groups: Kruskal-Wallis H 7.2, p 0.0036 (exact)" in str(found)
    assert found.figure().axes[1].get_title(loc="left") == "Kruskal-Wallis p 0.0036"


def test_of_many_groups_with_few_runs_the_numbers_are_said(tmp_path: Path) -> None:
    groups = [
        runs(tmp_path / str(size), [1.0, 2.0], method={**SEARCH, "population": size}) for size in (2, 3, 4, 5)
    ]
    few = "with fewer than 5 runs in a group (4 groups have {}) a test has little power"
    assert few.format("2") in compare([run for group in groups for run in group]).notes
    assert few.format("1 to 2") in compare([run for group in groups for run in group][1:]).notes


def test_one_group_alone_is_described(tmp_path: Path) -> None:
    for finals in ([3.0], [1.0, 2.0, 4.0]):
        found = compare(runs(tmp_path, finals))
        assert (found.pairs, found.kruskal, found.notes) == ((), None, ())
        assert found.groups[0].label == "minisim, nnga"
        assert str(found).count("\n") == 1
        drawn(found, tmp_path)


def test_runs_of_different_length_and_a_place_to_compare_at(tmp_path: Path) -> None:
    long = KnownRun(tmp_path / "long", [[0.0] * 4, [1.0] * 4, [5.0] * 4], seed=1)
    short = KnownRun(tmp_path / "short", [[2.0] * 4], seed=1, method=SEARCH)
    found = compare([long, short])
    assert [one.median for one in found.groups] == [5.0, 2.0]
    assert "4 to 12 evaluations, and each is compared at its end" in found.notes[-1]
    drawn(found, tmp_path)
    for at, expected in ((3, 0.0), (4, 0.0), (8, 1.0), (9, 5.0), (12, 5.0), (99, 5.0)):
        group = compare([long, short], at=at, order="given").groups[0]
        assert (group.median, group.evaluations) == (expected, (min(at, 12),) * 2)
    assert "own end" not in str(compare([long, short], at=4))


def test_the_first_evaluations_of_a_stored_run_are_compared(tmp_path: Path) -> None:
    values = {"simulation": "minisim", "servers": "local", "validate": {"episodes": 0}}
    method = {"kind": "nnga", "population": 7, "generations": 5}
    run = optimize(Experiment.from_mapping({**values, "method": method}), out=tmp_path / "run")
    fitness = run.record.fitness
    for at in (1, 6, 7, 9, 20, 22, 23):
        (group,) = compare([run.path], at=at).groups
        assert group.final.tolist() == [fitness[:at].max()]
        assert group.counts == (at,)
        assert compare([run.path], at=at).to_mapping()["groups"][0]["runs"][0]["evaluations"] == at


def test_candidates_that_are_evaluated_again_are_compared_after_a_generation(tmp_path: Path) -> None:
    again = {"ranking": {"reevaluate": True, "seeds": "new"}}
    run = KnownRun(tmp_path / "again", [[0.0] * 4, [1.0] * 4, [5.0] * 4], seed=1, **again)
    found = compare([run], at=11)
    assert (found.groups[0].median, found.groups[0].evaluations) == (1.0, (8, 8))
    words = (
        "are evaluated again, so the last generation that was finished within the first 11 evaluations counts"
    )
    assert any(words in note for note in found.notes)
    assert words not in str(compare([run], at=8))
    assert not any("ended before" in note for note in found.notes)
    with pytest.raises(InputError, match=r"at 3 evaluations .* compare at 4 or later"):
        compare([run], at=3)


def test_the_legend_has_the_order_of_the_boxes(tmp_path: Path) -> None:
    sizes = (4, 5, 6, 7, 8)
    some = [run for size in sizes for run in runs(tmp_path, [1.0], method={"population": size})]
    (legend,) = compare(some).figure().legends
    # Columns of at most two: 4 7, 5 8, 6.
    read = [text.get_text().split()[1] for text in legend.get_texts()]
    assert read == ["4", "7", "5", "8", "6"]


def test_archives_and_fronts_are_said_to_be_compared_by_fitness_alone(tmp_path: Path) -> None:
    front = {"kind": "nsga2", "population": 4, "generations": 2, "objectives": {"steps": "minimize"}}
    notes = compare([*runs(tmp_path, [1.0], method=front), *runs(tmp_path, [2.0])]).notes
    assert any(
        "only the best fitness is compared, not the archive or the front of nsga2" in one for one in notes
    )
    assert "only the best" not in str(compare(two(tmp_path)))


def test_an_effect_has_a_word_where_the_test_finds_a_difference(tmp_path: Path) -> None:
    few = compare([*runs(tmp_path, [7, 8, 9.0]), *runs(tmp_path, [1, 2, 3.0], method=SEARCH)])
    assert "1.00  too few runs" in str(few)
    assert few.to_mapping()["pairs"][0]["magnitude"] is None
    alike = compare([*runs(tmp_path, [1, 3, 5, 7, 8.0]), *runs(tmp_path, [2, 4, 6, 9, 9.5], method=SEARCH)])
    assert "0.64  not significant" in str(alike)
    # Of four runs each, p is 0.029, and of three such pairs 0.086.
    groups = [
        run
        for size in (4, 6, 9)
        for run in runs(
            tmp_path, [size, *(size + part / 9 for part in (1, 2, 3))], method={"population": size}
        )
    ]
    found = compare(groups)
    assert all(pair.difference.magnitude == "large" and pair.p_holm > 0.05 for pair in found.pairs)
    assert all(pair.magnitude == "" for pair in found.pairs)
    assert str(found).count("not significant") == 3
    assert "p 0.00017 (exact)" in str(found)


def test_p_and_intervals_that_disagree_because_of_ties_are_noted(tmp_path: Path) -> None:
    tied = [*runs(tmp_path, [3, 5, 5, 5, 3.0]), *runs(tmp_path, [0, 3, 1, 1, 3.0], method=SEARCH)]
    (note,) = compare(tied).notes
    assert note.startswith("p and the interval of the difference disagree for nnga against random_search")


def test_reference_models_are_compared_with_a_note(tmp_path: Path) -> None:
    arena = {"simulation": "arena", "servers": "local"}
    found = compare(
        [
            *runs(tmp_path, [5, 6, 7, 8, 9.0], **arena, controller={"kind": "evostick"}),
            *runs(
                tmp_path, [1, 2, 3, 4, 5.0], **arena, controller={"kind": "modules"},
                parameters={"robot": "e-puck-rm1.2"},
            ),
        ]
    )  # fmt: skip
    assert len(found.pairs) == 1
    (note,) = found.notes
    assert note.startswith("groups have different reference models of the e-puck")


def test_all_comparisons_of_runs(tmp_path: Path) -> None:
    """The one to report is first, and no note recommends what follows."""
    searched = {"kind": "random_search", "population": 40, "generations": 2}
    archive = {
        "kind": "map_elites", "population": 20, "evaluations": 80,
        "measures": {"steps": {"range": [0, 40], "bins": 4}},
    }  # fmt: skip
    validated = [*noisy(tmp_path, "few", 2, method=searched, ranking={"episodes": 2})]
    validated += noisy(tmp_path, "many", 2, method={**searched, "population": 50}, ranking={"episodes": 2})
    held_out, recorded = compare_all(validated)
    assert (held_out.held_out, recorded.held_out) == (True, False)
    assert str(recorded).startswith("Best recorded fitness of each run")
    (note,) = [note for note in recorded.notes if "too high" in note]
    assert note.endswith(
        "report fitness on held-out seeds, above, by which the order of groups may be another"
    )
    without = noisy(tmp_path, "without", 1, method=searched, ranking={"episodes": 2}, validate=False)
    (alone,) = compare_all([*validated, *without])
    assert not alone.held_out
    archives = noisy(tmp_path, "archives", 2, method=archive, validate=False)
    fitness, *indicators = compare_all(archives)
    assert [one.indicator.by for one in indicators] == ["qd_score", "coverage"]
    assert not any("only the best fitness" in note for note in fitness.notes)
    assert any("only the best fitness" in note for note in compare(archives).notes)
    assert compare_all([]) == []


def test_no_run_counts_as_failed_that_had_not_finished_a_generation(tmp_path: Path) -> None:
    quick = KnownRun(tmp_path / "quick", [[0.0] * 4, [1.0] * 4], seed=1)
    again = {"ranking": {"reevaluate": True, "seeds": "new"}}
    slow = KnownRun(tmp_path / "slow", [[2.0] * 8], seed=1, method={"population": 8}, **again)
    with pytest.raises(InputError, match=r"at 5 evaluations .*slow had no finished .* at 8 or later"):
        compare([quick, slow], at=5)


def test_failed_candidates_and_runs(tmp_path: Path) -> None:
    nan = math.nan
    partly = [KnownRun(tmp_path / f"p{seed}", [[nan, nan], [nan, 2.0]], seed=seed) for seed in range(3)]
    never = [KnownRun(tmp_path / f"n{seed}", [[nan, nan]], seed=seed, method=SEARCH) for seed in range(3)]
    found = compare([*partly, *never])
    assert found.groups[0].median == 2.0
    assert np.isnan(found.groups[1].final).all()
    assert found.pairs[0].difference.effect == 1.0
    assert "failed" in str(found)
    drawn(found, tmp_path)
    json.dumps(found.to_mapping())


@pytest.mark.slow
def test_extreme_fitness(tmp_path: Path) -> None:
    huge = [KnownRun(tmp_path / f"h{seed}", [[-1e300], [1e300]], seed=seed) for seed in range(5)]
    tiny = [
        KnownRun(tmp_path / f"t{seed}", [[-1e-300], [0.0]], seed=seed, method=SEARCH) for seed in range(5)
    ]
    found = compare([*huge, *tiny])
    assert "1e+300" in str(found)
    drawn(found, tmp_path)
    drawn(compare(tiny), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".png", ".svg", ".pdf"])
@pytest.mark.parametrize("x", ["evaluations", "generations"])
def test_the_same_figure_is_the_same_file(tmp_path: Path, ending: str, x: str) -> None:
    comparison = compare(two(tmp_path))
    for name in ("a", "b"):
        assert comparison.plot(tmp_path / f"{name}{ending}", x=x) == tmp_path / f"{name}{ending}"
    assert (tmp_path / f"a{ending}").read_bytes()[:4] in {b"\x89PNG", b"<?xm", b"%PDF"}
    assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()


def test_what_cannot_be_compared_or_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no runs to compare"):
        compare([])
    with pytest.raises(InputError, match="does not exist"):
        compare([tmp_path / "nowhere"])
    with pytest.raises(InputError, match="no finished generation"):
        compare([KnownRun(tmp_path / "empty", [])])
    for at in (0, -1):
        with pytest.raises(InputError, match=f"^at: must be at least 1, not {at}$"):
            compare(two(tmp_path), at=at)
    with pytest.raises(InputError, match=r"\.png, \.svg or \.pdf"):
        compare(two(tmp_path)).plot(tmp_path / "x.gif")
    with pytest.raises(InputError, match="does not exist; create it first"):
        compare(two(tmp_path)).plot(tmp_path / "nowhere" / "x.png")


def test_real_runs_by_path(tmp_path: Path) -> None:
    experiment = swarmwright.Experiment.from_mapping(
        {"simulation": "minisim", "servers": "local", "method": {"population": 5, "generations": 2}}
    )
    made: list[Run | Path] = []
    for seed in (1, 2):
        run = swarmwright.optimize(experiment, seed=seed, out=tmp_path / str(seed))
        made += [run.path if seed == 1 else run]
    found = compare(made)
    assert [run.path.name for run in found.groups[0].runs] == ["1", "2"]
    assert found.groups[0].final.max() == max(Run.open(tmp_path / name).best.fitness for name in ("1", "2"))
    shown: dict[str, Any] = found.to_mapping()
    assert [run["seed"] for run in shown["groups"][0]["runs"]] == [1, 2]


NOISY: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"placement": "random", "numDefenders": 3, "numAgents": 3, "maxSteps": 15},
    "servers": "in-process",
    "validate": {"episodes": 30, "candidates": 1},
}


def noisy(folder: Path, name: str, seeds: int = 3, **changes: Any) -> list[Run]:
    return [
        optimize(Experiment.from_mapping({**NOISY, "seed": seed, **changes}), out=folder / f"{name}-{seed}")
        for seed in range(seeds)
    ]


def test_fitness_on_held_out_seeds_is_compared(tmp_path: Path) -> None:
    raced = noisy(tmp_path, "raced", method={"kind": "racing", "evaluations": 300, "survivors": 4})
    searched = noisy(
        tmp_path, "searched", method={"kind": "random_search", "population": 150, "generations": 2}
    )
    recorded = compare([*raced, *searched])
    assert any("1 episode; the mean of all instances of racing" in note for note in recorded.notes)
    found = compare([*raced, *searched], held_out=True, order="given")
    assert found.held_out
    assert not any("instances of racing" in note for note in found.notes)
    for one, made in zip(found.groups, (raced, searched), strict=True):
        assert one.final.tolist() == [run.validation.best.mean.mean for run in made if run.validation]
    assert str(found).startswith("Mean fitness of each run's best candidate on held-out seeds:")
    assert found.to_mapping()["held_out"]
    assert "on held-out seeds" in found.figure().axes[1].get_ylabel().replace("\n", " ")
    with pytest.raises(InputError, match="leave out at, or leave out held_out"):
        compare(raced, at=200, held_out=True)
    (without,) = noisy(tmp_path, "without", 1, validate={"episodes": 0})
    with pytest.raises(
        InputError, match=r"without-0: not validated on held-out seeds; .* resume .*without-0"
    ):
        compare([*raced, without], held_out=True)


def test_runs_of_one_budget_are_validated_in_equally_many_episodes(tmp_path: Path) -> None:
    made = []
    searching = {"kind": "random_search", "population": 4}
    for name, method in (("nnga", {"kind": "nnga", "population": 33}), ("search", searching)):
        of_200 = {**method, "evaluations": 200}
        made += noisy(tmp_path, name, 1, method=of_200, validate={"episodes": "auto"})
    assert [run.evaluations for run in made] == [194, 200], "a twentieth of 194 is too few"
    assert [len(run.unseen.seeds) for run in made if run.unseen is not None] == [10, 10]
    assert "were validated" not in str(compare(made, held_out=True))
    more = noisy(tmp_path, "more", 1, method=SEARCH, validate={"episodes": 30})
    words = (
        "the runs were validated in 10 to 30 episodes, .* validate.episodes=30` validates a run in as many"
    )
    assert re.search(words, str(compare([*made, *more], held_out=True)))
    without = noisy(tmp_path, "without", 1, method={**SEARCH, "population": 5}, validate={"episodes": 0})
    (note,) = [note for note in compare([*made, *without]).notes if "too high" in note]
    assert note.endswith("fitness on held-out seeds is known of 2 of 3 runs")
    with pytest.raises(InputError, match=r"resume \S*without-0 --set validate.episodes=10` does it"):
        compare([*made, *without], held_out=True)


def test_luck_with_seeds_is_noted(tmp_path: Path) -> None:
    words = "the best recorded fitness is too high where fitness depends on the seed"
    new = {"ranking": {"seeds": "new"}}
    known = [*runs(tmp_path, [1, 2.0], **new), *runs(tmp_path, [1, 2.0], **new, method=SEARCH)]
    assert [note for note in compare(known).notes if words in note]
    assert words not in str(compare(two(tmp_path)))
    search = {"kind": "random_search", "population": 60, "generations": 1}
    validated = noisy(tmp_path, "same", method=search)
    (note,) = [note for note in compare(validated).notes if words in note]
    # A whole command: a sweep, and Python, have no such option.
    assert note.endswith(
        f"`swarmwright runs compare {tmp_path}/* --held-out` compares fitness on held-out seeds"
    )
    (tmp_path / "another").mkdir()
    (note,) = [note for note in compare(validated).notes if words in note]
    assert "`swarmwright runs compare RUN .. --held-out`" in note
    assert words not in str(compare(validated, held_out=True))
    # Fixed seeds without validation: episodes in the record tell.
    for name, parameters, noted in (("noisy", {}, True), ("sure", {"placement": "fixed"}, False)):
        some = noisy(
            tmp_path, name, 1, method=search, validate=False, ranking={"episodes": 2},
            parameters={**NOISY["parameters"], **parameters},
        )  # fmt: skip
        assert (words in str(compare(some))) is noted
    # One episode tells nothing.
    some = noisy(tmp_path, "one", 1, method=search, validate=False)
    (note,) = [note for note in compare(some).notes if "depends on the seed" in note]
    assert note == (
        "whether fitness depends on the seed is not known, as candidates had one episode each and runs were "
        "not validated; fitness on held-out seeds is known of 0 of 1 runs"
    )
    assert "not known" not in str(compare(validated))


def test_a_damaged_generation_does_not_prevent_a_comparison(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def damaged(_: KnownRun) -> None:
        raise InputError("is damaged")

    monkeypatch.setattr(KnownRun, "evaluation", damaged)
    assert compare(two(tmp_path)).notes == ()


def test_runs_that_go_on_did_not_end_early(tmp_path: Path) -> None:
    long = Experiment.from_mapping({**NOISY, "servers": "in-process", "method": {"generations": 3}})
    notes: list[str] = []

    def stop(generation: Generation) -> None:
        if generation.generation == 1:
            with pytest.raises(InputError, match=r"^no run has finished, .*live \(still running, \d+ evalu"):
                compare([tmp_path / "live"])
            notes.extend(compare([tmp_path / "live"], unfinished=True).notes)
            raise KeyboardInterrupt

    optimize(long, stop, out=tmp_path / "live")
    assert f"still running: {tmp_path / 'live'}" in notes
    assert not any("ended early" in note for note in notes)
    after = compare([tmp_path / "live"], unfinished=True).notes
    assert f"ended early: {tmp_path / 'live'}" in after
    assert not any("running" in note for note in after)


def test_runs_that_have_not_finished_do_not_count(tmp_path: Path) -> None:
    def fail(generation: Generation) -> None:
        if generation.generation == 1:
            raise ZeroDivisionError

    search = {"kind": "random_search", "population": 20, "generations": 4}
    for name, method in (("search", search), ("other", {**search, "population": 10})):
        noisy(tmp_path, name, 3, method=method, validate={"episodes": 20, "candidates": 1})
    values = {**NOISY, "method": search, "seed": 9}
    with pytest.raises(ZeroDivisionError):
        optimize(Experiment.from_mapping(values), fail, out=tmp_path / "search-9")
    given = sorted(tmp_path.iterdir())
    whole = compare([path for path in given if path.name != "search-9"])
    for held_out in (False, True):
        found = compare(given, held_out=held_out)
        (left,) = found.left_out
        (of_group,) = [one for one in found.groups if one.left_out]
        assert (left.path.name, left.seed, of_group.left_out) == ("search-9", 9, (left,))
        assert left.reason == "failed, 40 evaluations"
        assert "1 run is left out because it has not finished: " in str(found)
        assert re.search(r"group +runs +left out", str(found))
        assert found.pairs[0].difference != compare(given, unfinished=True).pairs[0].difference
    found = compare(given)
    assert found.pairs[0].difference == whole.pairs[0].difference
    legend = [text.get_text() for text in found.figure().legends[0].get_texts()]
    assert sorted("left out)" in text for text in legend) == [False, True]
    rows = list(csv.DictReader(found.export(tmp_path / "table.csv").read_text().splitlines()))
    assert [(row["seed"], row["left_out"], row["fitness"]) for row in rows if row["left_out"]] == [
        ("9", "failed, 40 evaluations", "")
    ]
    assert "left out" in found.export(tmp_path / "table.tex").read_text()
    mapping = found.to_mapping()
    assert sorted(one["left_out"] for one in mapping["groups"]) == [0, 1]
    assert mapping["left_out"][0]["reason"] == "failed, 40 evaluations"
    # It had 40 evaluations, so it counts where as many are compared.
    assert compare(given, at=40).left_out == ()
    assert len(compare(given, at=41).left_out) == 1


def test_unequal_budgets_are_noted_whatever_is_compared(tmp_path: Path) -> None:
    search = {"kind": "random_search", "population": 10}
    made = [
        *noisy(tmp_path, "short", 2, method={**search, "generations": 1}),
        *noisy(tmp_path, "long", 2, method={**search, "generations": 20}),
    ]
    for held_out in (False, True):
        (note,) = [one for one in compare(made, held_out=held_out).notes if "10 to 200 evaluations" in one]
        assert note.startswith("budgets are unequal" if held_out else "the runs have")
    assert [any("10 to 200 evaluations" in note for note in one.notes) for one in compare_all(made)] == [
        True, True,
    ]  # fmt: skip


def test_other_definitions_of_fitness_are_noted(tmp_path: Path) -> None:
    search = {"kind": "random_search", "population": 20, "generations": 1}
    plain = noisy(tmp_path, "plain", method=search)
    other = noisy(tmp_path, "other", method=search, fitness="1000 + arrived")
    found = compare([*plain, *other])
    assert [one.label for one in found.groups] == ["fitness not given", "fitness 1000 + arrived"]
    assert found.pairs == ()
    assert (
        "fitness not given; fitness 1000 + arrived are each the only one of their task and are tested "
        "against no other; tasks differ in fitness"
    ) in found.notes
    longer = noisy(tmp_path, "longer", method=search, parameters={**NOISY["parameters"], "maxSteps": 30})
    words = "groups differ in the simulation's parameters, so they solve different tasks: maxSteps"
    found = compare([*plain, *longer])
    assert words in found.notes
    assert len(found.tasks) == len(found.pairs) == 1  # nothing else differs: that is what is asked
    assert not any("tasks" in note for note in compare(plain).notes)


def test_runs_that_ended_before_are_named(tmp_path: Path) -> None:
    method = {"kind": "random_search", "population": 20, "generations": 4}
    long = noisy(tmp_path, "long", 1, method=method)
    short = noisy(tmp_path, "short", 1, method={**method, "generations": 2})
    notes = compare([*long, *short], at=60).notes
    assert f"ended before 60 evaluations, and count with what they had: {short[0].path}" in notes
    assert not any("ended before" in note for note in compare([*long, *short], at=40).notes)


def test_a_part_of_a_mission_is_all_that_differs(tmp_path: Path) -> None:
    values = {
        "simulation": "arena", "parameters": {"mission": "decision", "duration": 1}, "servers": "in-process",
        "method": {"kind": "random_search", "population": 4, "generations": 1}, "validate": {"episodes": 0},
    }  # fmt: skip
    named = Experiment.from_mapping(values)
    part = named.with_settings(["parameters.mission.robots=3"])
    made = [optimize(one, out=tmp_path / name) for name, one in (("named", named), ("part", part))]
    found = compare(made)
    assert sorted(one.label for one in found.groups) == ["robots 3", "robots not given"]
    assert (
        "groups differ in the simulation's parameters, so they solve different tasks: mission" in found.notes
    )
    other = optimize(named.replace(parameters={"mission": "stop"}), out=tmp_path / "other")
    assert [task.label for task in compare([made[0], other]).tasks] == ["mission decision", "mission stop"]


def test_the_two_names_of_a_mission_are_one_mission(tmp_path: Path) -> None:
    values = {
        "simulation": "arena", "parameters": {"duration": 1, "robots": 2}, "servers": "in-process",
        "method": {"kind": "random_search", "population": 4, "generations": 1}, "validate": {"episodes": 0},
    }  # fmt: skip
    made = []
    for seed, mission in enumerate((None, "aac", "aggregation")):
        parameters = {"duration": 1, "robots": 2} | ({"mission": mission} if mission else {})
        experiment = Experiment.from_mapping({**values, "parameters": parameters, "seed": seed})
        made.append(optimize(experiment, out=tmp_path / f"{mission}"))
    assert len(compare(made).groups) == 1
    parameters = {"duration": 1, "robots": 2, "mission": "shelter"}
    other = optimize(Experiment.from_mapping({**values, "parameters": parameters}), out=tmp_path / "other")
    labels = [one.label for one in compare([*made, other]).groups]
    assert labels == ["mission aggregation", "mission shelter"]
