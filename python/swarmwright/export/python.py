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
from swarmwright.export.programs import format_steps, parse_actuators, run
from swarmwright.export.python_family import PYTHON, PYTHON_WORDS, as_decimals, module_text, values_of
from swarmwright.export.python_modules import UserCode, export_user_modules, has_user_modules
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

_HARNESS = """
import sys
from array import array

sys.modules["swarmwright"] = None  # not available on robots
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


def format_modules(subject: Subject, prefix: str, numbers: Numbers, dialect: dict[str, str]) -> Files:
    """Return the module and, except for parameter sets, its self-test. Arguments as in `module_text`."""
    files: Files = {f"{prefix}.py": module_text(subject, prefix, numbers, dialect)}
    if subject.steers:
        files[f"{prefix}_test.py"] = _test(subject, values_of(subject, prefix))
    return files


def _test(subject: Subject, values: dict[str, str]) -> str:
    return render("python_test.txt", {**values, **Golden.from_subject(subject).values()})


class Python(Exporter):
    """`PREFIX.py`, a module for Python 3.9 and later without dependencies, and its self-test.

    Behaviours and conditions in Python are copied into `PREFIX_modules`; they need Python 3.10 and NumPy.
    """

    form: ClassVar[str] = "python"
    longest: ClassVar[int] = 12  # a step of a small network takes 20 us

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the module and its self-test, and the code of behaviours and conditions in Python.

        Raises InputError in the cases of `export_user_modules`.
        """
        check_module(prefix)
        user_code = export_user_modules(subject, prefix) if has_user_modules(subject) else UserCode({}, "")
        dialect = {
            **PYTHON,
            "words": f"{PYTHON_WORDS}{user_code.words}",
            "own": render("python_own_import.txt", {"p": prefix}).rstrip("\n") if user_code.files else "",
        }
        return {**format_modules(subject, prefix, as_decimals, dialect), **user_code.files}

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Step the class in a process of this Python."""
        (folder / "harness.py").write_text(_HARNESS.replace("PREFIX", prefix), encoding="utf-8")
        written = run(
            [sys.executable, "-I", "harness.py"], folder, "the exported module", format_steps(sequences)
        )
        return parse_actuators(written, sequences, "the exported module")

    def values(self, folder: Path, prefix: str) -> Mapping[str, object]:
        """Import the parameters."""
        show = f"import {prefix}; print(json.dumps({prefix}.PARAMETERS))"
        program = f"import json, sys; sys.path.insert(0, '.'); {show}"
        read: dict[str, object] = json.loads(run([sys.executable, "-I", "-c", program], folder, "the module"))
        return read

    def self_test(self, folder: Path, prefix: str) -> str | None:
        """Run `PREFIX_test.py`; None for parameter sets."""
        name = f"{prefix}_test.py"
        if not (folder / name).exists():
            return None
        output = run([sys.executable, name], folder, f"the self-test {name}")
        if output.strip() != b"ok":
            raise RunError(f"verification: the self-test {name} printed {output!r}, expected ok")
        return name
