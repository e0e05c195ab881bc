from pathlib import Path

from swarmwright.cli._reference import reference


def test_the_reference_page_is_up_to_date(root: Path) -> None:
    page = root / "docs" / "reference" / "command-line.md"
    # Word by word: how lines are broken is click's business and may change with its version.
    assert page.read_text(encoding="utf-8").split() == reference().split(), "`make reference` writes it anew"
