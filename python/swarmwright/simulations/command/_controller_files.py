"""Forms in which a command gets a controller: JSON, or source code of the exporters."""

from pathlib import PurePosixPath

from swarmwright.controllers.controller import Controller
from swarmwright.export import EXPORTERS, Subject, c, file_bytes

PREFIX = "controller"
_MAIN = {"json": ".json", "c": ".c", "cpp": ".hpp", "python": ".py", "onnx": ".onnx"}
"""The ending of the file that {controller} stands for."""
WEIGHTS = f"{PREFIX}.weights"
"""What the file is called that {weights} stands for."""
_PARTS = {".c", ".h", ".hpp", ".py", ".onnx"}


def main_file(form: str) -> str:
    """Return the name of the file that {controller} stands for."""
    return f"{PREFIX}{_MAIN[form]}"


def weights(controller: Controller) -> bytes:
    """Return the file that {weights} stands for."""
    return c.loaded_weights(Subject(controller.specification)).encode()


def files(form: str, controller: Controller, *, without_weights: bool = False) -> dict[str, bytes]:
    """Return the files of a controller by their names, without self-tests and what builds these.

    without_weights: C whose weights are in a file of their own, `weights`.
    """
    if without_weights:
        made = c.loaded_files(Subject(controller.specification), PREFIX)
        return {name: file_bytes(content) for name, content in made.items()}
    if form == "json":
        return {main_file(form): f"{controller.json}\n".encode()}
    written = EXPORTERS.get(form)().files(Subject(controller.specification), PREFIX)
    return {
        name: file_bytes(content)
        for name, content in written.items()
        if PurePosixPath(name).stem == PREFIX and PurePosixPath(name).suffix in _PARTS and "/" not in name
    }
