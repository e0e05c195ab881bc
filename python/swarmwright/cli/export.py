"""`swarmwright export`: a controller as source code or as a model."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from swarmwright.cli import _options as options
from swarmwright.cli._commands import Command
from swarmwright.cli._experiments import importer_of
from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from swarmwright.export.bundle import Bundle
    from swarmwright.export.subject import Subject


@click.command(
    "export",
    cls=Command,
    example="swarmwright export runs/minisim-1 --to c --output robot --verify\n"
    "swarmwright export runs/minisim-1 --to python --candidate 19:3 --prefix steering",
)
@click.argument("run", type=options.ExistingPath(folder=True))
@click.option(
    "--to",
    "form",
    metavar="FORMAT",
    help="c, cpp, fmu, fmu3, python, micropython, onnx, machine, ros1, ros2 or scxml, or a format of an "
    "installed package.",
)
@click.option(
    "--output",
    "target",
    cls=options.OutputOption,
    type=options.output_folder,
    metavar="DIR",
    help="Folder to write to. Default: the prefix, in the working folder.",
)
@options.candidate_options
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
    type=options.ExistingPath(),
    help="With --bundle: add this file as mapping.yaml, which maps sensors and actuators to topics.",
)
@click.option(
    "--license",
    "terms",
    type=options.ExistingPath(),
    help="With --bundle: add this text as LICENSE.txt. Default: permission to do anything with it.",
)
@click.option(
    "--model",
    "model",
    type=options.ExistingPath(folder=None),
    multiple=True,
    help="Instead of --to: write a copy of this file, which `swarmwright import` has read, with the "
    "candidate's values. Repeatable.",
)
@options.force_option
@options.trust_option
@options.json_option
def command(
    run: Path,
    form: str | None,
    target: Path | None,
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
    output: Output,
) -> int:
    """Export a controller for robots and other programs.

    The controller is the best candidate of RUN unless you name another. It keeps its state between steps, as
    in the simulation. With --verify, the exit status is 1 unless its output is bit-identical to the
    simulation's, or for ONNX within 1e-5.
    """
    from swarmwright.export import EXPORTERS
    from swarmwright.export.bundle import export_bundle
    from swarmwright.export.exporting import PREFIX, export_controller

    if target is not None and (target / "run.sqlite").exists() and target.resolve() != run.resolve():
        raise click.UsageError(f"--output {target}: is the folder of another run; name a separate folder")
    chosen: dict[str, Any] = {"generation": generation, "candidate": candidate, "force": force}
    options.exclude("--bundle", "--to", "--output", "--verify", "--model")
    options.exclude("--model", "--to", "--verify")
    options.need("--model", "--output")
    options.need("--mapping", "--bundle")
    options.need("--license", "--bundle")
    if bundle is not None:
        bundled = export_bundle(
            run, bundle, group=group, prefix=prefix or PREFIX, mapping=mapping, license=terms, **chosen
        )
        _print_bundle(output, run, bundle, bundled)
        return 0
    if model and target is not None:
        subject, written = importer_of(model).write_back(run, model, target, **chosen)
        _print_subject(output, subject, written)
        output.json({"run": str(run), "files": [str(file) for file in written]})
        return 0
    if form is None:
        raise click.UsageError(
            f"name a format: --to {', '.join(EXPORTERS.names())}; or give --bundle FILE.zip or --model FILE"
        )
    exported = export_controller(
        run, to=form, output=target, group=group, prefix=prefix, verify=verify, **chosen
    )
    facts = _print_subject(output, exported.subject, exported.files)
    verification = exported.verification
    record = {"run": str(run), "to": form, "files": [str(file) for file in exported.files], **facts}
    if verification is None:
        output.json(record)
        return 0
    checked = {
        "largest_difference": verification.largest_difference,
        "verification": verification.to_mapping(),
    }
    output.json(record | checked)
    if verification.self_test:
        output.text(f"The self-test {verification.self_test} is ok")
    if verification.without_episodes:
        output.text(f"Verified without episodes: {verification.without_episodes}")
    output.text(f"Verified: {verification.words}" if verification.ok else verification.words)
    return 0 if verification.ok else 1


def _print_subject(output: Output, subject: "Subject", files: Sequence[Path] = ()) -> dict[str, str]:
    """Print which controller was exported, and its files; return the facts on it for `--json`."""
    facts = dict(subject.facts)
    output.text(f"Candidate {facts['Candidate']}, fitness {facts['Fitness']}: {facts['Controller']}")
    for file in files:
        output.text(f"  {file}")
    return {name.lower(): text for name, text in facts.items() if name != "Run"}


def _print_bundle(output: Output, run: Path, file: Path, bundled: "Bundle") -> None:
    """Print the content of an archive."""
    facts = _print_subject(output, bundled.subject)
    for form, verification in bundled.verified.items():
        output.text(f"  {form}: {verification.words}")
    for form, reason in bundled.unverified.items():
        output.text(f"  {form}: not verified: {reason}")
    for form, reason in bundled.without.items():
        output.text(f"  {form}: left out: {reason}")
    output.text(f"{file}: SHA-256 of the manifest {bundled.digest}")
    output.json(
        {
            "run": str(run),
            "bundle": str(file),
            "digest": bundled.digest,
            **facts,
            "verified": {form: verification.to_mapping() for form, verification in bundled.verified.items()},
            "unverified": bundled.unverified,
            "without": bundled.without,
        }
    )
