"""Comparisons as files."""

import csv
import dataclasses
import subprocess
from pathlib import Path
from shutil import which

import pytest

from swarmwright import Comparison, InputError, compare
from swarmwright.analysis.indicators import Indicator
from swarmwright.analysis.table import latex_text
from swarmwright.common.processes import StablePath
from tests.python.analysis.runs import runs

OTHER = {"kind": "random_search", "population": 4, "generations": 3}


def test_every_run_has_a_row(tmp_path: Path) -> None:
    made = [
        *runs(tmp_path, [5, 6, 7.5], parameters={"maxSteps": 10}),
        *runs(tmp_path, [1, 2, 3.0], parameters={"maxSteps": 10}, method=OTHER),
        *runs(tmp_path, [4, 5.0], parameters={"maxSteps": 20}, method=OTHER),
    ]
    path = compare(made).export(tmp_path / "table.csv")
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        "task", "group", "run", "seed", "left_out", "evaluations", "episodes", "failed", "fitness",
        "held_out_fitness", "held_out_episodes", "held_out_failed", "held_out_standard_error", "held_out_low",
        "held_out_high", "seconds",
        "record_sha256", "parameters.maxSteps", "method.kind",
    ]  # fmt: skip
    assert [float(row["fitness"]) for row in rows] == [5, 6, 7.5, 1, 2, 3, 4, 5]
    assert [row["task"] for row in rows] == ["maxSteps 10"] * 6 + ["maxSteps 20"] * 2
    assert [row["method.kind"] for row in rows] == ["nnga"] * 3 + ["random_search"] * 5
    assert rows[0]["run"] == made[0].path.name
    assert (rows[0]["seconds"], rows[0]["record_sha256"]) == ("1.5", "0" * 64)
    assert {rows[0][key] for key in rows[0] if key.startswith("held_out")} == {""}
    (tmp_path / "tables").mkdir()
    elsewhere = compare(made).export(tmp_path / "tables" / "table.csv").read_text()
    assert f"/{made[0].path.name},1,," in elsewhere


def test_no_text_is_a_formula_or_the_end_of_a_row(tmp_path: Path) -> None:
    made = [*runs(tmp_path, [5, 6.0], fitness="-arrived"), *runs(tmp_path, [1, 2.0], fitness="arrived")]
    made[0]._place = StablePath(tmp_path / '=HYPERLINK("x")\r[evil]')
    comparison = compare(made)
    text = comparison.export(tmp_path / "table.csv").read_text()
    row = next(csv.DictReader(text.splitlines()))
    assert row["run"] == './=HYPERLINK("x")\\r[evil]'
    assert (row["group"], row["fitness"], row["experiment.fitness"]) == (
        "fitness -arrived",
        "5.0",
        "'-arrived",
    )
    groups = tuple(dataclasses.replace(group, label=f"[{group.label}]") for group in comparison.groups)
    tasks = (dataclasses.replace(comparison.tasks[0], groups=groups),)
    assert r"{}[" in latex_text(dataclasses.replace(comparison, groups=groups, tasks=tasks))


def test_latex_tables_have_groups_and_tests(tmp_path: Path) -> None:
    made = [*runs(tmp_path, [5, 6, 7, 8, 9.0]), *runs(tmp_path, [1, 2, 3, 4, 5.0], method=OTHER)]
    text = compare(made).export(tmp_path / "table.tex").read_text()
    groups, tests = text.split(r"\end{tabular}")[:2]
    assert r"nnga & 5 & 4 & 4 & 7 & 6 & 8 & 5 & 9 \\" in groups
    assert r"random\_search & 5 & 4 & 4 & 3 & 2 & 4 & 1 & 5 \\" in groups
    assert r"nnga & random\_search & large & 0.98 & 4 & " in tests
    assert "(Holm)" not in tests
    assert text.count(r"\bottomrule") == 2


def test_latex_tables_say_what_is_compared_and_when(tmp_path: Path) -> None:
    made = [*runs(tmp_path, [5, 6.0]), *runs(tmp_path, [1, 2.0], method=OTHER)]

    def line(comparison: Comparison) -> str:
        return comparison.export(tmp_path / "table.tex").read_text().splitlines()[1]

    ended = compare(made)
    assert line(ended) == "% best recorded fitness of each run, at its end"
    assert line(compare(made, at=4)) == "% best recorded fitness of each run, after 4 evaluations"
    held_out = dataclasses.replace(ended, held_out=True)
    assert line(held_out) == "% mean fitness of each run's best candidate on held-out seeds, at its end"
    said = line(dataclasses.replace(ended, indicator=Indicator("coverage")))
    assert said.startswith("% Coverage of each run's archive")
    assert said.endswith(", at its end")


@pytest.mark.parametrize("name", ["table.xlsx", "none/table.csv"])
def test_where_no_table_can_be_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"ends with \.csv or \.tex|there is no folder"):
        compare(runs(tmp_path, [5, 6.0])).export(tmp_path / name)


@pytest.mark.skipif(which("pdflatex") is None, reason="LaTeX is not installed")
def test_latex_accepts_them(tmp_path: Path) -> None:
    odd = runs(tmp_path, [1, 2.0], fitness="100 * (arrived > 3) ** 2")
    compare([*runs(tmp_path, [5, 6.0]), *odd]).export(tmp_path / "table.tex")
    (tmp_path / "all.tex").write_text(
        "\\documentclass{article}\\usepackage{booktabs}\\begin{document}\\input{table.tex}\\end{document}\n"
    )
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "all.tex"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=60)
