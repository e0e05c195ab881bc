"""Export of a candidate of a run, for `swarmwright export` and `swarmwright.export_controller`."""

from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.common.arguments import check_arguments, text
from swarmwright.common.errors import RunError
from swarmwright.controllers.source.text import check_prefix, word_of
from swarmwright.export import EXPORTERS
from swarmwright.export.subject import Subject, load_subject
from swarmwright.export.verification import Verification, verify
from swarmwright.export.writing import check_case, check_replaceable, write

if TYPE_CHECKING:
    from swarmwright.runs.run import Run

PREFIX = "controller"


@dataclass(frozen=True)
class ExportResult:
    """An exported controller, and its comparison with the simulation."""

    files: list[Path]
    """The written files."""
    subject: Subject = field(repr=False)
    """The controller and its origin."""
    verification: Verification | None
    """Comparison with the simulation; None without `verify`."""


@check_arguments
def export_controller(
    run: "Run | str | PathLike[str]",
    *,
    to: str,
    output: str | PathLike[str] | None = None,
    generation: int | None = None,
    candidate: int | None = None,
    group: str | None = None,
    prefix: str | None = None,
    verify: bool = False,
    force: bool = False,
) -> ExportResult:
    """Export a controller as source code or as a model, for robots and other programs.

    The same run and candidate give the same bytes. The controller keeps its state between steps, as in
    the simulation, and its actuators are bit-identical.

    Args:
        run: a run, or its folder.
        to: "c", "cpp", "fmu", "fmu3", "machine", "micropython", "onnx", "python", "ros1", "ros2", "scxml",
            or a format of an installed package.
        output: folder to write to; by default, `prefix` in the current folder.
        generation: generation of the candidate, from 0; as in `Run.evaluation`.
        candidate: as in `Run.evaluation`; default: the best.
        group: group of agents whose controller is exported; required if groups have different controllers.
        prefix: prefix of files, functions and types, so that a program can contain several controllers; by
            default "controller", or the name of the group.
        verify: compile and run the controller, in 10,000 random sequences and in the run's episodes, and
            compare its actuators with the simulation's.
        force: overwrite files that Swarmwright did not export, or that were edited since.

    Raises:
        InputError: the candidate, group or format does not exist, the prefix is not an identifier, or differs
            in case only from that of existing files, a file cannot be overwritten, or a program that
            verification needs is not installed. Nothing is written then.
        RunError: the exported controller does not compile or run.

    Examples:
        >>> exported = swarmwright.export_controller("result", to="python", output="robot")
        >>> sorted(path.name for path in exported.files)
        ['controller.py', 'controller_test.py']

    See also: `export_bundle`, for every format in one archive with its proof.
    """
    from swarmwright.runs.run import open_run  # noqa: PLC0415 - with figures and more

    if prefix is None:
        prefix = PREFIX if group is None else _prefix_of(group)
    check_prefix(prefix)
    exporter = EXPORTERS.get(text("to", to, "the name of an export format"))()
    opened = open_run(run)
    subject = load_subject(opened, generation, candidate, group)
    files = exporter.files(subject, prefix)
    folder = Path(output if output is not None else prefix)
    check_case(files, folder, prefix)
    check_replaceable(files, folder, force=force)
    try:
        verification = _verify(exporter, subject, prefix, files) if verify else None
    except RunError:
        write(files, folder, force=force)  # for inspection
        raise
    return ExportResult(write(files, folder, force=force), subject, verification)


def _prefix_of(group: str) -> str:
    """Return the default prefix of a group of agents."""
    word = word_of(group)
    return word if word[:1].isalpha() else f"group_{word}"


_verify = verify
