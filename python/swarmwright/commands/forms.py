"""Forms in which a command gets a controller: JSON, or source code of the exporters."""

import importlib
from pathlib import PurePosixPath
from typing import Any

PREFIX = "controller"
_MAIN = {"json": ".json", "c": ".c", "cpp": ".hpp", "python": ".py"}
"""The ending of the file that {controller} stands for."""
_PARTS = {".c", ".h", ".hpp", ".py", ".json"}


def main_file(form: str) -> str:
    """Return the name of the file that {controller} stands for."""
    return f"{PREFIX}{_MAIN[form]}"


def files(form: str, controller: Any) -> dict[str, str]:  # noqa: ANN401 - a Controller, which is above this
    """Return the files of a controller by their names, without self-tests and what builds these."""
    if form == "json":
        return {main_file(form): f"{controller.json}\n"}
    # By name, as plug-ins are: exporters are above this package.
    export = importlib.import_module("swarmwright.export")
    exporter = export.EXPORTERS.get(form)()
    written = exporter.files(export.Subject(controller.specification), PREFIX)
    return {
        name: text
        for name, text in written.items()
        if PurePosixPath(name).stem == PREFIX and PurePosixPath(name).suffix in _PARTS and "/" not in name
    }
