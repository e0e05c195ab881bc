"""MicroPython: `--to micropython`."""

import ast
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import RunError
from swarmwright.controllers.source.text import check_module
from swarmwright.export._base import Exporter, Files, export_error
from swarmwright.export.programs import find_command, parse_actuators, run
from swarmwright.export.python import format_modules
from swarmwright.export.python_family import MICROPYTHON, as_bytes, split_sequences
from swarmwright.export.python_modules import has_user_modules
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

_INSTALL = (
    "apt install micropython where the distribution has it, or "
    "npm install @micropython/micropython-webassembly-pyscript"
)
_WEBASSEMBLY = Path("node_modules", "@micropython", "micropython-webassembly-pyscript", "micropython.mjs")
_HEAP = ["-X", "heapsize=64m"]
_NUMBERS = 20_000
"""Largest number of values in a program, which contains its input: a WebAssembly port cannot read files."""

_HARNESS = """
from binascii import hexlify, unhexlify
from struct import pack

controller = Controller()
for line in DATA.split():
    row = unpack("<%df" % (1 + len(SENSORS)), unhexlify(line))
    if row[0]:
        controller.reset()
    try:
        out = [1.0] + list(controller.step(row[1:]))
    except ValueError:
        out = [0.0] + [7.0] * len(ACTUATORS)
    print(hexlify(pack("<%df" % len(out), *out)).decode())
"""
_EXACT = '''
EXACT = 1.0 + 1.0 / 8388608.0 != 1.0
"""Whether floats have at least 32 bits here. Some ports (ESP8266 among them) cut them to 30; then the last
bits of actuators differ from the simulation's."""
'''


class MicroPython(Exporter):
    """`PREFIX.py`, a module for MicroPython with floats of 32 or 64 bits, and its self-test."""

    form: ClassVar[str] = "micropython"
    longest: ClassVar[int] = 8  # a WebAssembly port takes 0.3 ms for a step of a small network

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the module and its self-test. Raises InputError for modules in Python, which need NumPy."""
        check_module(prefix)
        if has_user_modules(subject):
            raise export_error(subject, "MicroPython", ())
        dialect = {
            "dialect": MICROPYTHON,
            "imports": "from array import array\nfrom struct import unpack",
            "own": "",
            "words": "Numbers are bytes: MicroPython does not read every decimal as the nearest number.",
            "exact": _EXACT.rstrip("\n"),
            "none": "",
            "sensors_type": "",
            "actuators_type": "",
        }
        return format_modules(subject, prefix, as_bytes, dialect)

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Step the class in MicroPython, in successive processes."""
        interpreter = _find_interpreter()
        module = (folder / f"{prefix}.py").read_text(encoding="utf-8")
        rows = np.column_stack([sequences.first.astype("<f4"), sequences.sensors]).astype("<f4")
        written = []
        for part in split_sequences(sequences, _NUMBERS // rows.shape[1]):
            data = "\n".join(row.tobytes().hex() for row in rows[part])
            script = folder / "harness.py"
            script.write_text(f'{module}\nDATA = """\n{data}\n"""\n{_HARNESS}', encoding="utf-8")
            written.append(run([*interpreter, script.name], folder, "the module in MicroPython"))
        output = b"".join(bytes.fromhex(line) for line in b"".join(written).decode().split())
        return parse_actuators(output, sequences, "the module in MicroPython")

    def values(self, folder: Path, prefix: str) -> Mapping[str, object]:
        """Run the module and read its parameters."""
        module = (folder / f"{prefix}.py").read_text(encoding="utf-8")
        (folder / "harness.py").write_text(f"{module}\nprint(repr(PARAMETERS))\n", encoding="utf-8")
        output = run([*_find_interpreter(), "harness.py"], folder, "the module in MicroPython")
        values: dict[str, object] = ast.literal_eval(output.decode())
        return values

    def self_test(self, folder: Path, prefix: str) -> str | None:
        """Run `PREFIX_test.py`, appended to the module; None for parameter sets."""
        name = f"{prefix}_test.py"
        if not (folder / name).exists():
            return None
        module, test = ((folder / file).read_text(encoding="utf-8") for file in (f"{prefix}.py", name))
        import_line = f"from {prefix} import "
        lines = [line for line in test.splitlines() if not line.startswith(import_line)]
        (folder / "harness.py").write_text("\n".join([module, *lines]) + "\n", encoding="utf-8")
        output = run([*_find_interpreter(), "harness.py"], folder, f"the self-test {name}")
        if output.strip() != b"ok":
            raise RunError(f"verification: the self-test {name} printed {output!r}, expected ok")
        return name


def _find_interpreter() -> list[str]:
    """Return the command of MicroPython: installed, or its WebAssembly port in node_modules.

    Raises InputError, which names the package to install, without MicroPython.
    """
    if "MICROPYTHON" not in os.environ and not shutil.which("micropython") and shutil.which("node"):
        current = Path.cwd()
        for folder in (current, *current.parents):
            if (folder / _WEBASSEMBLY).is_file():
                return ["node", str(folder / _WEBASSEMBLY), *_HEAP]
    return [*find_command("MICROPYTHON", ("micropython",), _INSTALL), *_HEAP]
