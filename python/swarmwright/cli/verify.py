"""`swarmwright verify`: a bundle that somebody hands over."""

from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import ExistingPath, json_option
from swarmwright.cli._output import Output, show_warnings


@click.command("verify", cls=Command, example="swarmwright verify flight.zip")
@click.argument("bundle", type=ExistingPath(folder=None), metavar="BUNDLE")
@json_option
def command(bundle: Path, as_json: bool) -> int:
    """Check an archive of `swarmwright export --bundle`.

    BUNDLE is the archive, or the folder that it was unpacked to. Every file must be as its manifest says;
    each form of the controller is exported again, compared, compiled and run; and the controller is evaluated
    again. The exit status is 1 when anything is not as stated. Only code that this version of Swarmwright
    exports itself is executed.
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
    for form, one in found.forms.items():
        said.text(f"{form}: {one.words}")
    for form, reason in found.unverified.items():
        said.text(f"{form}: not verified: {reason}")
    if found.not_evaluated:
        said.text(f"Not evaluated again: {found.not_evaluated}")
    elif found.episodes:
        said.text(f"Evaluated again in {found.episodes} episode{'s' if found.episodes > 1 else ''}")
    for problem in found.problems:
        said.text(f"PROBLEM: {problem}")
    said.text(f"Verified: {found.words}" if found.ok else found.words)
    said.json({"bundle": str(bundle), **found.to_mapping()})
    return 0 if found.ok else 1
