"""What every format of an exported controller does."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.ranges import shortest_decimal
from swarmwright.controllers.kinds import KINDS, kind_of, part
from swarmwright.controllers.modules import grammar
from swarmwright.controllers.source.text import MARK, plain, table, templates
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

render = templates(__file__, "templates")
"""Renders the templates of this package, see `controllers.source.text.templates`."""

Files = dict[str, str | bytes]
"""Content by path, relative to the folder that is exported to."""


def file_bytes(content: str | bytes) -> bytes:
    """Return the content of a file as it is written: text in UTF-8."""
    return content if isinstance(content, bytes) else content.encode()


class NotInstalledError(InputError):
    """A package that a format needs is not installed."""


class Exporter(ABC):
    """Writes controllers in one form, and checks what was written.

    An exporter is one file and one line in `swarmwright.export`; other packages announce theirs as entry
    points in the group `swarmwright.exporters`.
    """

    form: ClassVar[str]
    """Name after `--to`."""
    tolerance: ClassVar[float] = 0.0
    """Largest difference from the simulation's actuators that is promised; 0 promises the same bits."""

    refuses: ClassVar[bool] = True
    """Whether it refuses a sensor that is NaN or infinite."""
    longest: ClassVar[int] = 30
    """Steps of a random sequence, at most, with which it is verified."""

    compiled: ClassVar[bool] = False
    """Whether it holds code that this machine's compiler made, so that its bytes differ between machines; see
    `portable`."""

    untried: ClassVar[str] = ""
    """What of it no verification compiles or runs; empty where that is nothing."""

    @abstractmethod
    def files(self, subject: Subject, prefix: str) -> Files:
        """Return what is written, the same bytes for the same subject.

        Args:
            subject: the controller.
            prefix: begins names and files; a valid identifier in C, C++ and Python.

        Raises:
            InputError: controllers of this kind cannot be exported to this format.
            NotInstalledError: a package that this needs is not installed.
        """

    def portable(self) -> "Exporter":
        """Return the exporter that writes the same bytes on every machine, for bundles.

        Default: this one. Raises InputError where the form has only compiled code.
        """
        if self.compiled:
            raise InputError(
                f"compiled for one kind of machine; export it where it is used, with --to {self.form}"
            )
        return self

    @abstractmethod
    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Run what was written and return the actuators of each step, (steps, actuators).

        Args:
            folder: a temporary one with the files.
            prefix: as in `files`.
            sequences: where controllers refuse a sensor that is NaN or infinite, that is checked too.

        Raises:
            InputError: a program that this needs is not installed.
            RunError: it could not be compiled, or failed.
        """

    def values(self, folder: Path, prefix: str) -> Mapping[str, object] | None:  # noqa: ARG002 - for others
        """Return what was written for a parameter set, read back: values by the names of parameters.

        Default: None, its self-test is trusted.

        Args:
            folder: a temporary one with the files.
            prefix: as in `files`.

        Raises as `run`.
        """
        return None

    def self_test(self, folder: Path, prefix: str) -> str | None:  # noqa: ARG002 - for those who have one
        """Run the generated self-test; return its name, None without one, the default.

        Args:
            folder: a temporary one with the files.
            prefix: as in `files`.

        Raises as `run`.
        """
        return None


def part_of(subject: Subject, language: str, form: str) -> Any:  # noqa: ANN401 - as the field of `Kind` says
    """Return what the kind of a controller has for a language: c, python or onnx.

    Args:
        subject: that steers agents.
        language: the field of `Kind`.
        form: what the language is called in messages.

    Raises InputError for kinds without it.
    """
    address = getattr(kind_of(subject.specification), language)
    if not address:
        known = (name for name, kind in KINDS.items() if getattr(kind, language) and not kind.swarm)
        raise not_exported(subject, form, known)
    return part(address)


def not_exported(subject: Subject, form: str, known: Iterable[str]) -> InputError:
    """Return the error for a controller of a kind that the format does not have; known: those it has."""
    kinds = ", ".join(sorted(known))
    reason = f"controller: the kind {subject.kind!r} cannot be exported to {form}, only {kinds}"
    if kind_of(subject.specification).swarm:
        catalogue = grammar.Catalogue.of(subject.specification)
        own = [
            module.name for module in (*catalogue.behaviours, *catalogue.conditions) if not module.built_in
        ]
        reason = (
            f"controller: its modules {', '.join(own)} are code in Python, which {form} does not run; "
            "--to python copies it, --to c, cpp, fmu, ros1 and ros2 take code in C beside it, --to machine "
            "writes the machine with their names"
        )
    return InputError(reason)


def facts(subject: Subject, begin: str = " * ", advice: str = "changes here are lost") -> str:
    """Return where a controller comes from, as lines of a comment; advice: to who would edit the file."""
    from swarmwright import __version__  # noqa: PLC0415 - asks the engine

    # Those of a bundle are its sender's, who could write code behind the end of a comment.
    said = [(plain(name), plain(text)) for name, text in subject.facts]
    if subject.step_size:
        said.append(("Control cycle", f"{shortest_decimal(subject.step_size)} s, a step of the simulation"))
    rows = [*table(said, begin), f"{begin}{MARK} {__version__}; {advice}."]
    return "\n".join(row.rstrip() for row in rows)
