"""Code that was edited after this process imported it is warned of."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from swarmwright import Experiment, optimize
from swarmwright.simulations.loading import load
from tests.python.simulations.user_code.conftest import edit

VALUES = {
    "controller": {"kind": "layered", "hidden": []},
    "method": {"population": 6, "generations": 1},
    "servers": "in-process",
}
WORDS = (
    "was edited after this process imported it, so this process runs the old code, but servers and the copy"
)


@pytest.mark.parametrize(
    ("file", "old", "new", "told"),
    [
        ("gather.py", "self.left -= 1", "self.left -= 1 * 1 + 1", True),
        ("gather.py", "return -self.position", "return -2 * self.position", True),
        ("gather.py", "class Gather(", "# a comment\n\nclass Gather(", False),
    ],
)
def test_an_edit_after_the_import(
    file: str, old: str, new: str, told: bool, project: Path, monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    monkeypatch.syspath_prepend(str(project))
    experiment = Experiment.from_mapping({"simulation": "gather:Gather", **VALUES})
    optimize(experiment, out=project / "before")
    assert not caplog.messages
    assert "gather" in sys.modules
    edit(project / file, old, new)
    optimize(experiment, out=project / "after")
    assert [f"{file}: {WORDS}" in message for message in caplog.messages] == [True] * told


def test_a_constant_with_another_value(
    project: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.syspath_prepend(str(project))
    experiment = Experiment.from_mapping({"simulation": "gather:Gather", **VALUES})
    optimize(experiment, out=project / "before")
    monkeypatch.setattr(sys.modules["helper"], "GAIN", 0.25)
    optimize(experiment, out=project / "after")
    assert [message.partition(" use: ")[0] for message in caplog.messages] == [
        "helper.py: GAIN is 0.25 in this process and 0.1 in the file, which servers and the copy in the run"
    ]
    assert "make it a parameter of the simulation" in caplog.messages[0]


def test_what_ipython_has_reloaded_is_no_edit(
    project: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    autoreload = pytest.importorskip("IPython.extensions.autoreload")
    monkeypatch.syspath_prepend(str(project))
    reloader = autoreload.ModuleReloader()
    experiment = Experiment.from_mapping({"simulation": "gather:Gather", **VALUES})
    optimize(experiment, out=project / "before")
    reloader.check(check_all=True, do_reload=False)
    edit(project / "gather.py", "return -self.position", "return -2 * self.position")
    stamp = (project / "gather.py").stat().st_mtime + 10
    os.utime(project / "gather.py", (stamp, stamp))
    reloader.check(check_all=True)
    assert "2" in repr(sys.modules["gather"].Gather.fitness.__code__.co_consts)
    caplog.clear()
    optimize(experiment, out=project / "after")
    assert not caplog.messages


def test_a_file_that_was_edited_is_imported_again(project: Path, caplog: pytest.LogCaptureFixture) -> None:
    experiment = Experiment.from_mapping({"simulation": f"{project}/gather.py:Gather", **VALUES})
    optimize(experiment, out=project / "before")
    edit(project / "gather.py", "self.left -= 1", "self.left -= 1 * 1 + 1")
    edit(project / "helper.py", "GAIN = 0.1", "GAIN = 0.25")
    optimize(experiment, out=project / "after")
    assert not [message for message in caplog.messages if WORDS in message]


def test_modules_of_the_working_folder_come_before_those_beside_files_loaded_earlier(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "from swarmwright import Simulation\n\nclass Walk(Simulation):\n    sensors = actuators = 1\n"
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "namesake.py").write_text(text)
    load(str(tmp_path / "one" / "namesake.py:Walk"))
    monkeypatch.chdir(tmp_path / "two")
    assert sys.modules[load("namesake:Walk").__module__].__file__ == str(tmp_path / "two" / "namesake.py")


@pytest.mark.slow
def test_compiled_code_of_the_same_second_is_not_used(project: Path) -> None:
    helper = project / "helper.py"
    command = [sys.executable, "-m", "py_compile", str(helper)]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPYCACHEPREFIX"}
    subprocess.run(command, check=True, timeout=60, env=environment)
    (compiled,) = (project / "__pycache__").glob("helper.*.pyc")
    second = helper.stat().st_mtime_ns // 10**9 * 10**9
    # As an editor would that saves the file right after it was imported by another process.
    helper.write_text(helper.read_text().replace("GAIN = 0.1", "GAIN = 0.9"))
    os.utime(compiled, ns=(second, second + 300_000_000))
    os.utime(helper, ns=(second, second + 700_000_000))
    module = sys.modules[load(f"{project}/gather.py:Gather").__module__]
    assert vars(module)["GAIN"] == 0.9
