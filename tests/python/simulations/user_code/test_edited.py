"""An experiment.yaml that was edited in a run folder is noticed, and changes nothing by itself."""

from pathlib import Path

import pytest

from swarmwright import Experiment, InputError, Run, optimize, repeat, resume
from swarmwright.runs.code import describe_edits
from tests.conftest import Run as Program
from tests.python.records import same_record
from tests.python.simulations.user_code.conftest import edit

EXPERIMENT = Experiment.from_mapping(
    {"simulation": "minisim", "method": {"population": 6, "generations": 3}, "servers": "local"}
)


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return optimize(EXPERIMENT, out=tmp_path / "run")


def test_keys_on_which_results_depend_are_refused(run: Run, caplog: pytest.LogCaptureFixture) -> None:
    file = run.path / "experiment.yaml"
    edit(file, "population: 6", "population: 60")
    edit(file, "\nseed: 1\n", "\nseed: 12\n")
    edited = file.read_text()
    for arguments in ({}, {"generations": 5}):
        with pytest.raises(InputError, match=r"experiment\.yaml was edited") as caught:
            resume(run, **arguments)  # type: ignore[arg-type] # a number
        assert "\n  method.population is 60 in the file, 6 in the run\n" in str(caught.value)
        assert "\n  seed is 12 in the file, 1 in the run\n" in str(caught.value)
    assert file.read_text() == edited
    assert repeat(run).same
    assert [line for line in caplog.messages if "using the recorded experiment" in line]
    assert len(describe_edits(run)) == 1
    # Either way out.
    again = optimize(file, out=run.path.parent / "again")
    assert (again.experiment.seed, again.evaluations > run.evaluations) == (12, True)
    file.unlink()
    longer = resume(run, generations=5)
    same_record(
        longer, optimize(EXPERIMENT.replace(method={"generations": 5}), out=run.path.parent / "whole")
    )


def test_a_budget_is_given_as_an_option(run: Run) -> None:
    edit(run.path / "experiment.yaml", "generations: 3", "generations: 10")
    with pytest.raises(InputError, match="To prolong the run, use the option --generations"):
        resume(run)
    with pytest.raises(InputError, match=r"method\.generations is 10 in the file, 3 in the run"):
        resume(run, generations=7)
    assert resume(run, generations=10).generations == 10


def test_the_file_of_a_run_that_was_prolonged_is_no_edit(run: Run, caplog: pytest.LogCaptureFixture) -> None:
    longer = resume(run, generations=5)
    assert repeat(run).same
    assert describe_edits(run) == []
    assert "was edited" not in caplog.text
    edit(run.path / "experiment.yaml", "\nseed: 1\n", "\nseed: 12\n")
    assert describe_edits(run) == describe_edits(longer)
    assert describe_edits(run)[0].endswith("was edited: seed is 12 in the file, 1 in the run")


@pytest.mark.slow
def test_where_it_is_computed_is_taken_over(run: Run, caplog: pytest.LogCaptureFixture) -> None:
    file = run.path / "experiment.yaml"
    edit(file, "servers: local", "servers: 1")
    edit(file, "attempts: 3", "attempts: 10")
    longer = resume(run, generations=5)
    assert (longer.experiment.servers, longer.experiment.faults.attempts) == (1, 10)
    assert longer.sessions[-1].place != "in this process"
    notes = sorted(event.text for event in longer.events() if event.kind == "changed")
    assert notes == ["experiment.yaml: faults.attempts 3 -> 10", "experiment.yaml: servers 'local' -> 1"]
    assert [
        line for line in caplog.messages if "continuing with experiment.yaml: servers 'local' -> 1" in line
    ]
    assert describe_edits(longer) == []


def test_what_says_the_same_is_no_edit(run: Run) -> None:
    file = run.path / "experiment.yaml"
    edit(file, "\nseed: 1\n", "\n")  # the default
    file.write_text("# mine\n" + file.read_text())
    assert describe_edits(run) == []
    assert resume(run, generations=4).generations == 4


def test_a_file_that_is_no_experiment_any_more(run: Run, caplog: pytest.LogCaptureFixture) -> None:
    with (run.path / "experiment.yaml").open("a") as file:
        file.write("colour: red\n")
    with pytest.raises(InputError, match=r"colour: unknown key(.|\n)*restore it, or delete it"):
        resume(run, generations=5)
    assert repeat(run).same
    assert "was edited and can no longer be read" in caplog.text


@pytest.mark.slow
def test_the_program_says_so(run: Run, program: Program) -> None:
    edit(run.path / "experiment.yaml", "population: 6", "population: 60")
    refused = program("resume", run.path, "--generations", "5")
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "method.population is 60 in the file, 6 in the run" in refused.stderr
    shown = program("runs", "show", run.path)
    assert "method.population is 60 in the file, 6 in the run" in shown.stdout
    repeated = program("evaluate", run.path, "--json")
    assert repeated.returncode == 0
    assert "using the recorded experiment" in repeated.stderr
