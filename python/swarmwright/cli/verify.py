"""`swarmwright verify`: a bundle from another user."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import ExistingPath, json_option
from swarmwright.cli._output import Output
from swarmwright.common.formatting import format_count


@click.command("verify", cls=Command, example="swarmwright verify flight.zip")
@click.argument("bundle", type=ExistingPath(folder=None))
@click.option(
    "--require-fitness",
    is_flag=True,
    help="Also exit with 1 if the fitness was not checked, for example because the simulation is not "
    "built-in.",
)
@click.option(
    "--require-formats",
    is_flag=True,
    help="Also exit with 1 if a format was not checked, for example because another version of "
    "Swarmwright wrote it.",
)
@json_option
def command(bundle: Path, require_fitness: bool, require_formats: bool, output: Output) -> int:
    """Check an archive of `swarmwright export --bundle`.

    BUNDLE is the archive or the folder it was unpacked to. Every file is checked against the manifest. The
    controller is exported again to each format, compared, compiled and run, and evaluated again if its
    simulation is built-in. The last line names unchecked fitness and formats. The exit status is 1 if
    anything differs. Only code that this version of Swarmwright exports itself is executed.
    """
    from swarmwright.export.bundle import verify_bundle

    verified = verify_bundle(bundle)
    output.text(f"{bundle}: SHA-256 of the manifest {verified.digest}")
    for name, text in verified.facts:
        output.text(f"  {name:<12}{text}")
    if verified.ok:
        output.text(f"{verified.files} files are as the manifest says")
    for form, verification in verified.forms.items():
        output.text(f"{form}: {verification.words}")
    for form, reason in verified.unverified.items():
        output.text(
            f"{form}: not {'checked' if form in verified.formats_not_checked else 'verified'}: {reason}"
        )
    if verified.not_evaluated:
        output.text(f"Not evaluated again: {verified.not_evaluated}")
    elif verified.episodes:
        output.text(f"Evaluated again in {format_count(verified.episodes, 'episode')}")
    for problem in verified.problems:
        output.text(f"PROBLEM: {problem}")
    output.text(str(verified))
    output.json({"bundle": str(bundle), **verified.to_mapping()})
    missing = (require_fitness and verified.fitness_not_checked) or (
        require_formats and verified.formats_not_checked
    )
    return 0 if verified.ok and not missing else 1
