"""Base class of export formats."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.formatting import format_table
from swarmwright.common.ranges import shortest_decimal
from swarmwright.controllers.kinds import KINDS, import_part, kind_of
from swarmwright.controllers.modules import grammar
from swarmwright.controllers.source.text import MARK, plain, templates
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

render = templates(__file__, "templates")
"""Renders the templates of this package, see `controllers.source.text.templates`."""

Files = dict[str, str | bytes]
"""Content by path, relative to the target folder."""


def file_bytes(content: str | bytes) -> bytes:
    """Return the content of a file as bytes, text in UTF-8."""
    return content if isinstance(content, bytes) else content.encode()


class NotInstalledError(InputError):
    """A package required by a format is not installed."""


class Exporter(ABC):
    """Writes controllers in one format, and verifies the files.

    An exporter is one file and one line in `swarmwright.export`; other packages register theirs as entry
    points in the group `swarmwright.exporters`.
    """

    form: ClassVar[str]
    """Name after `--to`."""
    tolerance: ClassVar[float] = 0.0
    """Guaranteed largest difference from the simulation's actuators; 0: bit-identical."""

    refuses: ClassVar[bool] = True
    """Whether the exported controller refuses sensors that are NaN or infinite."""
    longest: ClassVar[int] = 30
    """Largest number of steps of a random sequence for verification."""

    compiled: ClassVar[bool] = False
    """Whether the files contain compiled code, so that their bytes depend on the machine; see `portable`."""

    untried: ClassVar[str] = ""
    """Part that no verification compiles or runs; empty if everything is."""

    @abstractmethod
    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the files, the same bytes for the same subject.

        Args:
            subject: the controller.
            prefix: prefix of names and files; a valid identifier in C, C++ and Python.

        Raises:
            InputError: controllers of this kind cannot be exported to this format.
            NotInstalledError: a required package is not installed.
        """

    def portable(self) -> "Exporter":
        """Return an exporter that writes the same bytes on every machine, for bundles.

        Default: this exporter. Raises InputError if the format consists of compiled code only.
        """
        if self.compiled:
            raise InputError(
                f"compiled for one kind of machine; export it on the target machine with --to {self.form}"
            )
        return self

    @abstractmethod
    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Run the files and return the actuators of each step, (steps, actuators).

        Args:
            folder: a temporary folder with the files.
            prefix: as in `files`.
            sequences: inputs; refusals of NaN and infinite sensors are checked, too.

        Raises:
            InputError: a required program is not installed.
            RunError: the compilation or the program failed.
        """

    def values(self, folder: Path, prefix: str) -> Mapping[str, object] | None:  # noqa: ARG002 - for subclasses
        """Read back the files of a parameter set: values by parameter name.

        Default: None, the self-test is trusted.

        Args:
            folder: a temporary folder with the files.
            prefix: as in `files`.

        Raises the errors of `run`.
        """
        return None

    def self_test(self, folder: Path, prefix: str) -> str | None:  # noqa: ARG002 - for subclasses
        """Run the generated self-test; return its name, or None (the default) without a self-test.

        Args:
            folder: a temporary folder with the files.
            prefix: as in `files`.

        Raises the errors of `run`.
        """
        return None


def find_generator(subject: Subject, language: str, form: str) -> Any:  # noqa: ANN401 - as the field of `Kind` says
    """Return the code generator of a kind of controller for a language: c, python or onnx.

    Args:
        subject: a controller that steers agents.
        language: the field of `Kind`.
        form: name of the language in messages.

    Raises InputError for kinds without a generator.
    """
    address = getattr(kind_of(subject.specification), language)
    if not address:
        supported = (name for name, kind in KINDS.items() if getattr(kind, language) and not kind.swarm)
        raise export_error(subject, form, supported)
    return import_part(address)


def export_error(subject: Subject, form: str, supported: Iterable[str]) -> InputError:
    """Return the error for an unsupported kind of controller; supported: kinds of the format."""
    kinds = ", ".join(sorted(supported))
    reason = f"controller: the kind {subject.kind!r} cannot be exported to {form}, only {kinds}"
    if kind_of(subject.specification).swarm:
        catalogue = grammar.Catalogue.from_specification(subject.specification)
        user_modules = [
            module.name for module in (*catalogue.behaviours, *catalogue.conditions) if not module.built_in
        ]
        reason = (
            f"controller: {form} does not support its Python modules {', '.join(user_modules)}; use --to "
            "python, --to machine, or, for modules with C code, --to c, cpp, fmu, ros1 or ros2"
        )
    return InputError(reason)


def format_facts(subject: Subject, begin: str = " * ", advice: str = "changes here are lost") -> str:
    """Return the origin of a controller as lines of a comment; advice: to users who edit the file."""
    from swarmwright import __version__  # noqa: PLC0415 - asks the engine

    # Facts of a bundle are untrusted and must not end the comment.
    entries = [(plain(name), plain(text)) for name, text in subject.facts]
    if subject.step_size:
        entries.append(
            ("Control cycle", f"{shortest_decimal(subject.step_size)} s, a step of the simulation")
        )
    rows = [*format_table(entries, begin), f"{begin}{MARK} {__version__}; {advice}."]
    return "\n".join(row.rstrip() for row in rows)
