"""What notebooks show: a real one, run by a real kernel, and the parts of it."""

import html
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller, Experiment, InputError, Run

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:(jupyter|nbclient|zmq|tornado|ipykernel)")

CELLS = (
    """\
import pandas as pd
import swarmwright
experiment = swarmwright.Experiment.from_mapping(
    {"simulation": "minisim", "method": {"population": 8, "generations": 4}}
)
experiment""",
    "run = swarmwright.optimize(experiment, out='run')",
    "run",
    "run.best.controller",
    "run.plot()",
    "run.replay()",
    "pd.DataFrame(run.record).shape",
    "result = swarmwright.sweep({'experiment': experiment, 'grid': {'method.population': [6]}, 'seeds': 2})",
    "result",
)


@pytest.mark.slow
def test_a_notebook_shows_progress_and_what_came_out(tmp_path: Path) -> None:
    import nbformat
    from nbclient import NotebookClient

    new: Any = nbformat.v4
    notebook = new.new_notebook(cells=[new.new_code_cell(cell) for cell in CELLS])
    notebook.metadata["kernelspec"] = {"name": "python3", "display_name": "Python", "language": "python"}
    client = NotebookClient(notebook, timeout=50, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    outputs: list[list[Any]] = [cell.outputs for cell in notebook.cells]

    def shown(cell: int) -> Any:
        return outputs[cell][-1]["data"]

    assert "<td" in shown(0)["text/html"]
    assert len(outputs[1]) == 1, "one text, replaced as it goes on"
    assert shown(1)["text/plain"].startswith("4 of 4 generations  best ")
    assert "data:image/png;base64," in shown(2)["text/html"]
    assert "4 generations" in shown(2)["text/html"]
    assert "data:image/png;base64," in shown(3)["text/html"]
    assert "image/png" in shown(4)
    assert shown(5)["text/html"].startswith('<iframe title="minisim: candidate ')
    run = Run.open(tmp_path / "run")
    assert shown(6)["text/plain"] == str((run.evaluations, 4 + 49))
    assert shown(7)["text/plain"].startswith("2 of 2 runs done")
    assert shown(8)["text/html"].count("<tr>") == 3


def test_without_a_notebook_nothing_is_shown_unless_it_is_wanted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from swarmwright import optimize

    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "servers": "local", "method": {"population": 6, "generations": 2}}
    )
    optimize(experiment, out=tmp_path / "quiet")
    assert capsys.readouterr() == ("", "")
    seen: list[int] = []
    optimize(experiment, lambda now: seen.append(now.generation), out=tmp_path / "told", progress=True)
    assert seen == [0, 1]
    assert "2 of 2 generations  best " in capsys.readouterr().err


def test_the_record_is_an_arrow_stream(finished: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    import pyarrow as pa

    table = pa.RecordBatchReader.from_stream(finished.record).read_all()
    assert table.column_names == list(finished.record)
    for name, column in finished.record.items():
        assert table[name].to_numpy().tobytes() == column.tobytes()
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"needs PyArrow: pip install 'swarmwright\[parquet\]'"):
        finished.record.__arrow_c_stream__()


def test_the_record_is_a_table_for_pandas_and_alike(finished: Run, tmp_path: Path) -> None:
    import pandas as pd

    finished.export(tmp_path / "record.csv")
    exported = pd.read_csv(tmp_path / "record.csv")
    frame = pd.DataFrame(finished.record)
    assert list(frame) == list(exported)
    assert np.array_equal(frame["fitness"], exported["fitness"])
    assert np.array_equal(frame["g48"].to_numpy(), exported["g48"].to_numpy().astype(np.float32))
    record: Any = finished.record
    assert (len(record), "g48" in record, "g49" in record) == (len(exported.columns), True, False)
    assert dict(record).keys() == set(exported.columns)
    assert record["episode_1"].tolist() == finished.record.episodes[:, 1].tolist()
    assert repr(record).startswith(f"<Record: {finished.evaluations} evaluations, 2 episodes each, 49 genes")


def test_what_is_shown_is_escaped(tmp_path: Path) -> None:
    name = "<script>alert(1)<&script>.yaml"
    (tmp_path / name).write_text("simulation: minisim\nparameters: {helloMessage: '<img src=x>'}\n")
    shown = Experiment.load(tmp_path / name)._repr_html_()
    assert "<script>" not in shown
    assert "<img" not in shown
    assert html.escape("<img src=x>") in shown


def test_controllers_of_all_kinds_are_shown(finished: Run) -> None:
    shown = finished.best.controller._repr_html_()
    assert "layered" in shown
    assert "<img" in shown
    values = Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": {"steering": "rule"},
            "controller": {
                "kind": "parameter_set",
                "parameters": {"evasion": {"type": "categorical", "choices": ["left", "right"]}},
            },
        }
    )
    representation = values.representation()
    genome = np.zeros(representation.genome_size, dtype=np.float32)
    assert "parameter_set" in Controller(representation.specification(genome))._repr_html_()


def test_a_replay_is_a_page_also_outside_notebooks(finished: Run, tmp_path: Path) -> None:
    page = finished.replay(generation=0, candidate=3, episode=1, speed=2.0)
    assert "candidate 3 of generation 0" in repr(page)
    assert page.fitness == finished.evaluation(3, 0).episodes[1]
    page.save(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert text == page.html
    assert text.lstrip().lower().startswith("<!doctype html")
    frame = page._repr_html_()
    assert html.escape(text) in frame
    with pytest.raises(InputError, match="has generations 0 to 3, but no generation 9"):
        finished.replay(generation=9)
    with pytest.raises(InputError, match="cannot be written"):
        page.save(tmp_path / "nowhere" / "page.html")
