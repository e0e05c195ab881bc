"""Python without NumPy: `--to python`."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import RunError
from swarmwright.controllers.source.in_python import Numbers
from swarmwright.controllers.source.text import check_module
from swarmwright.export._base import Exporter, Files, render
from swarmwright.export.golden import Golden
from swarmwright.export.programs import run, stepped, steps
from swarmwright.export.python_family import PYTHON, PYTHON_WORDS, as_decimals, module_text, values_of
from swarmwright.export.python_modules import OwnPython, has_own, own_python
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

_HARNESS = """
import sys
from array import array

sys.modules["swarmwright"] = None  # robots have none
sys.path.insert(0, ".")
from PREFIX import ACTUATORS, SENSORS, Controller

controller = Controller()
data, width = array("f", sys.stdin.buffer.read()), 1 + len(SENSORS)
for at in range(0, len(data), width):
    if data[at]:
        controller.reset()
    try:
        row = [1.0, *controller.step(data[at + 1 : at + width])]
    except ValueError:
        row = [0.0] + [7.0] * len(ACTUATORS)
    sys.stdout.buffer.write(array("f", row).tobytes())
"""


def modules(subject: Subject, prefix: str, numbers: Numbers, dialect: dict[str, str]) -> Files:
    """Return the module and its self-test; parameters have none. Arguments as of `module_text`."""
    files: Files = {f"{prefix}.py": module_text(subject, prefix, numbers, dialect)}
    if subject.steers:
        files[f"{prefix}_test.py"] = _test(subject, values_of(subject, prefix))
    return files


def _test(subject: Subject, values: dict[str, str]) -> str:
    return render("python_test.txt", {**values, **Golden.of(subject).values()})


class Python(Exporter):
    """`PREFIX.py`, a module for Python 3.9 and later that needs no other, and its self-test.

    Behaviours and conditions in Python are copied into `PREFIX_modules`; they need Python 3.10 and NumPy.
    """

    form: ClassVar[str] = "python"
    longest: ClassVar[int] = 12  # a step of a small network takes 20 us

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the module and its self-test, and the code of behaviours and conditions in Python.

        Raises InputError as `own_python` does.
        """
        check_module(prefix)
        own = own_python(subject, prefix) if has_own(subject) else OwnPython({}, "")
        dialect = {
            **PYTHON,
            "words": f"{PYTHON_WORDS}{own.words}",
            "own": render("python_own_import.txt", {"p": prefix}).rstrip("\n") if own.files else "",
        }
        return {**modules(subject, prefix, as_decimals, dialect), **own.files}

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Step the class in a process of this Python."""
        (folder / "harness.py").write_text(_HARNESS.replace("PREFIX", prefix), encoding="utf-8")
        written = run([sys.executable, "-I", "harness.py"], folder, "the exported module", steps(sequences))
        return stepped(written, sequences, "the exported module")

    def values(self, folder: Path, prefix: str) -> Mapping[str, object]:
        """Import the parameters."""
        show = f"import {prefix}; print(json.dumps({prefix}.PARAMETERS))"
        program = f"import json, sys; sys.path.insert(0, '.'); {show}"
        read: dict[str, object] = json.loads(run([sys.executable, "-I", "-c", program], folder, "the module"))
        return read

    def self_test(self, folder: Path, prefix: str) -> str | None:
        """Run `PREFIX_test.py`; parameters have none."""
        name = f"{prefix}_test.py"
        if not (folder / name).exists():
            return None
        said = run([sys.executable, name], folder, f"the self-test {name}")
        if said.strip() != b"ok":
            raise RunError(f"verification: the self-test {name} said {said!r}, expected ok")
        return name
