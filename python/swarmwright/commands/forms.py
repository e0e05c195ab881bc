"""Forms in which a command gets a controller: JSON, or source code of the exporters."""

import importlib
from pathlib import PurePosixPath
from typing import Any

PREFIX = "controller"
_MAIN = {"json": ".json", "c": ".c", "cpp": ".hpp", "python": ".py", "onnx": ".onnx"}
"""The ending of the file that {controller} stands for."""
_PARTS = {".c", ".h", ".hpp", ".py", ".onnx"}


def main_file(form: str) -> str:
    """Return the name of the file that {controller} stands for."""
    return f"{PREFIX}{_MAIN[form]}"


def files(form: str, controller: Any) -> dict[str, bytes]:  # noqa: ANN401 - a Controller, which is above this
    """Return the files of a controller by their names, without self-tests and what builds these."""
    if form == "json":
        return {main_file(form): f"{controller.json}\n".encode()}
    # By name, as plug-ins are: exporters are above this package.
    export = importlib.import_module("swarmwright.export")
    exporter = export.EXPORTERS.get(form)()
    written = exporter.files(export.Subject(controller.specification), PREFIX)
    return {
        name: text if isinstance(text, bytes) else text.encode()
        for name, text in written.items()
        if PurePosixPath(name).stem == PREFIX and PurePosixPath(name).suffix in _PARTS and "/" not in name
    }
