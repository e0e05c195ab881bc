"""`swarmwright verify`: a bundle from another user."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import ExistingPath, json_option
from swarmwright.cli._output import Output, show_warnings


@click.command("verify", cls=Command, example="swarmwright verify flight.zip")
@click.argument("bundle", type=ExistingPath(folder=None), metavar="BUNDLE")
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
def command(bundle: Path, require_fitness: bool, require_formats: bool, as_json: bool) -> int:
    """Check an archive of `swarmwright export --bundle`.

    BUNDLE is the archive or the folder it was unpacked to. Every file is checked against the manifest. The
    controller is exported again to each format, compared, compiled and run, and evaluated again if its
    simulation is built-in. The last line names unchecked fitness and formats. The exit status is 1 if
    anything differs. Only code that this version of Swarmwright exports itself is executed.
    """
    from swarmwright.export.bundle_verification import verify_bundle

    said = Output(as_json=as_json)
    show_warnings()
    found = verify_bundle(bundle)
    said.text(f"{bundle}: SHA-256 of the manifest {found.digest}")
    for name, text in found.facts:
        said.text(f"  {name:<12}{text}")
    if found.ok:
        said.text(f"{found.files} files are as the manifest says")
    for form, verification in found.forms.items():
        said.text(f"{form}: {verification.words}")
    for form, reason in found.unverified.items():
        said.text(f"{form}: not {'checked' if form in found.formats_not_checked else 'verified'}: {reason}")
    if found.not_evaluated:
        said.text(f"Not evaluated again: {found.not_evaluated}")
    elif found.episodes:
        said.text(f"Evaluated again in {found.episodes} episode{'s' if found.episodes > 1 else ''}")
    for problem in found.problems:
        said.text(f"PROBLEM: {problem}")
    said.text(str(found))
    said.json({"bundle": str(bundle), **found.to_mapping()})
    missing = (require_fitness and found.fitness_not_checked) or (
        require_formats and found.formats_not_checked
    )
    return 0 if found.ok and not missing else 1
