from pathlib import Path

from click.testing import CliRunner

from swarmwright.cli._commands import Command
from swarmwright.cli._reference import reference


def test_the_reference_page_is_up_to_date(root: Path) -> None:
    page = root / "docs" / "reference" / "command-line.md"
    # Word by word: how lines are broken is click's business and may change with its version.
    assert page.read_text(encoding="utf-8").split() == reference().split(), "`make reference` writes it anew"


def test_help_has_both_options_without_a_program_above() -> None:
    alone = Command("alone", example="alone", callback=lambda: None)
    assert "-h, --help" in CliRunner().invoke(alone, ["--help"]).output
