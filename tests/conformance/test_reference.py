from pathlib import Path

from swarmwright.conformance._reference import reference


def test_the_reference_page_is_up_to_date(root: Path) -> None:
    page = root / "docs" / "reference" / "conformance.md"
    assert page.read_text(encoding="utf-8") == reference(), "`make reference` writes it anew"
