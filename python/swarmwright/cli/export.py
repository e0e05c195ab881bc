"""`swarmwright export`: a controller as source code or as a model."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._experiments import importer_of
from swarmwright.cli._options import (
    ExistingPath,
    OutputFolder,
    OutputOption,
    candidate_options,
    json_option,
    trust_option,
)
from swarmwright.cli._output import Output, show_warnings


@click.command(
    "export",
    cls=Command,
    example="swarmwright export runs/minisim-1 --to c --output robot --verify\n"
    "swarmwright export runs/minisim-1 --to python --candidate 19:3 --prefix steering",
)
@click.argument("run", type=ExistingPath(folder=True), metavar="RUN")
@click.option(
    "--to",
    "form",
    metavar="FORMAT",
    help="c, cpp, fmu, fmu3, python, micropython, onnx, machine, ros1, ros2 or scxml, or a format of an "
    "installed package.",
)
@click.option(
    "--output",
    cls=OutputOption,
    type=OutputFolder(),
    metavar="DIR",
    help="Folder to write to. Default: the prefix, in the working folder.",
)
@candidate_options
@click.option(
    "--group",
    metavar="NAME",
    help="Group whose controller is exported; required for controllers of the kind team.",
)
@click.option(
    "--prefix",
    metavar="NAME",
    help="Prefix of files, functions and types: NAME.c, NAME_step. Controllers in one program need "
    "different ones. Default: controller, or the group's name.",
)
@click.option(
    "--verify",
    is_flag=True,
    help="Compile and run the exported code in 10,000 random sequences and in the run's episodes, and "
    "compare its actuators with the simulation's.",
)
@click.option(
    "--bundle",
    type=click.Path(path_type=Path),
    metavar="FILE.zip",
    help="Instead of --to: write an archive with every format, verified where its compiler is installed, "
    "the record of the evaluation and a manifest. `swarmwright verify` checks it.",
)
@click.option(
    "--mapping",
    type=ExistingPath(),
    metavar="FILE",
    help="With --bundle: add this file as mapping.yaml, which maps sensors and actuators to topics.",
)
@click.option(
    "--license",
    "terms",
    type=ExistingPath(),
    metavar="FILE",
    help="With --bundle: add this text as LICENSE.txt. Default: permission to do anything with it.",
)
@click.option(
    "--model",
    "model",
    type=ExistingPath(folder=None),
    multiple=True,
    metavar="FILE",
    help="Instead of --to: write a copy of this file, which `swarmwright import` has read, with the "
    "candidate's values. Repeatable.",
)
@click.option(
    "--force",
    is_flag=True,
    help="Overwrite files that Swarmwright did not export, or that were edited since.",
)
@trust_option
@json_option
def command(
    run: Path,
    form: str | None,
    output: Path | None,
    generation: int | None,
    candidate: int | None,
    group: str | None,
    prefix: str | None,
    verify: bool,
    bundle: Path | None,
    mapping: Path | None,
    terms: Path | None,
    model: tuple[Path, ...],
    force: bool,
    as_json: bool,
) -> int:
    """Export a controller for robots and other programs.

    The controller is the best candidate of RUN unless you name another. It keeps its state between steps, as
    in the simulation. With --verify, the exit status is 1 unless its output is bit-identical to the
    simulation's, or for ONNX within 1e-5.
    """
    from swarmwright.export import EXPORTERS
    from swarmwright.export.exporting import PREFIX, export_controller

    printer = Output(as_json=as_json)
    show_warnings()
    _check_output(output, run)
    if bundle is not None:
        if form is not None or output is not None or verify:
            raise click.UsageError(
                "--bundle holds all formats, verified: leave out --to, --output and --verify"
            )
        if group is not None:
            raise click.UsageError("--group goes with --to: a bundle holds one controller for all agents")
        prefix = prefix or PREFIX
        return _bundle(printer, run, bundle, generation, candidate, prefix, mapping, terms, force=force)
    if model:
        if form is not None or verify or output is None:
            raise click.UsageError(
                "--model writes into a folder: name it with --output, leave out --to and --verify"
            )
        return _model(printer, run, model, output, generation, candidate, force=force)
    if form is None:
        raise click.UsageError(
            f"name a format: --to {', '.join(EXPORTERS.names())}; or give --bundle FILE.zip or --model FILE"
        )
    if mapping is not None or terms is not None:
        raise click.UsageError("--mapping and --license are for bundles: name one with --bundle FILE.zip")
    exported = export_controller(
        run,
        to=form,
        output=output,
        generation=generation,
        candidate=candidate,
        group=group,
        prefix=prefix,
        verify=verify,
        force=force,
    )
    facts = dict(exported.subject.facts)
    printer.text(f"Candidate {facts['Candidate']}, fitness {facts['Fitness']}: {facts['Controller']}")
    for file in exported.files:
        printer.text(f"  {file}")
    verification = exported.verification
    printer.json(
        {
            "run": str(run),
            "to": form,
            "files": [str(file) for file in exported.files],
            **{name.lower(): text for name, text in facts.items() if name != "Run"},
            **(
                {}
                if verification is None
                else {
                    "largest_difference": verification.largest_difference,
                    "verification": verification.to_mapping(),
                }
            ),
        }
    )
    if verification is None:
        return 0
    if verification.self_test:
        printer.text(f"The self-test {verification.self_test} is ok")
    if verification.without_episodes:
        printer.text(f"Verified without episodes: {verification.without_episodes}")
    printer.text(f"Verified: {verification.words}" if verification.ok else verification.words)
    return 0 if verification.ok else 1


def _check_output(output: Path | None, run: Path) -> None:
    if output is not None and (output / "run.sqlite").exists() and output.resolve() != run.resolve():
        raise click.UsageError(f"--output {output}: is the folder of another run; name a separate folder")


def _model(
    printer: Output,
    run: Path,
    files: tuple[Path, ...],
    output: Path,
    generation: int | None,
    candidate: int | None,
    *,
    force: bool,
) -> int:
    """Write copies of a model's files with a candidate's values, and say where they are."""
    subject, written = importer_of(files).write_back(
        run, files, output, generation=generation, candidate=candidate, force=force
    )
    facts = dict(subject.facts)
    printer.text(f"Candidate {facts['Candidate']}, fitness {facts['Fitness']}: {facts['Controller']}")
    for file in written:
        printer.text(f"  {file}")
    printer.json({"run": str(run), "files": [str(file) for file in written]})
    return 0


def _bundle(
    printer: Output,
    run: Path,
    file: Path,
    generation: int | None,
    candidate: int | None,
    prefix: str,
    mapping: Path | None,
    terms: Path | None,
    *,
    force: bool,
) -> int:
    """Write an archive, and say what is in it."""
    from swarmwright.export.bundle import export_bundle

    bundled = export_bundle(
        run,
        file,
        generation=generation,
        candidate=candidate,
        prefix=prefix,
        mapping=mapping,
        license=terms,
        force=force,
    )
    facts = dict(bundled.subject.facts)
    printer.text(f"Candidate {facts['Candidate']}, fitness {facts['Fitness']}: {facts['Controller']}")
    for form, verification in bundled.verified.items():
        printer.text(f"  {form}: {verification.words}")
    for form, reason in bundled.unverified.items():
        printer.text(f"  {form}: not verified: {reason}")
    for form, reason in bundled.without.items():
        printer.text(f"  {form}: left out: {reason}")
    printer.text(f"{file}: SHA-256 of the manifest {bundled.digest}")
    printer.json(
        {
            "run": str(run),
            "bundle": str(file),
            "digest": bundled.digest,
            **{name.lower(): text for name, text in facts.items() if name != "Run"},
            "verified": {form: verification.to_mapping() for form, verification in bundled.verified.items()},
            "unverified": bundled.unverified,
            "without": bundled.without,
        }
    )
    return 0
