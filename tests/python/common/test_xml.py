"""XML is read without reaching out, and without trust."""

import tracemalloc
from pathlib import Path

import pytest

from swarmwright import InputError
from swarmwright.common import xml
from swarmwright.common.xml import read


def test_lines_and_text(tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    path.write_text('<?xml version="1.0"?>\n<a>\n <b c="1">x&amp;y</b>\n</a>')
    root = read(path)
    inner = root.find_one("b")
    assert (inner.line, inner.attribute("c"), inner.text) == (3, "1", "x&y")
    assert [element.tag for element in root.walk()] == ["a", "b"]


def test_a_dtd_is_not_fetched(tmp_path: Path) -> None:
    # Nobody answers there; were it opened, reading would fail or hang.
    (tmp_path / "x.dtd").write_text('<!ATTLIST a b CDATA "fetched">')
    path = tmp_path / "x.xml"
    for system in ("http://127.0.0.1:1/x.dtd", "x.dtd", str(tmp_path / "x.dtd")):
        path.write_text(f'<!DOCTYPE a SYSTEM "{system}"><a/>')
        assert read(path).attributes == {}


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("", "x.xml:1: is not valid XML: no element found"),
        ("<a>\n<b></a>", "x.xml:2: is not valid XML: mismatched tag"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "x.xml:1: uses the entity b"),
        ('<!DOCTYPE a [<!ENTITY b SYSTEM "/etc/passwd">]><a>&b;</a>', "uses the entity b"),
        ('<!DOCTYPE a [<!ENTITY % b SYSTEM "x">%b;]><a/>', "uses the entity b"),
        ("<a>&b;</a>", "is not valid XML: undefined entity"),
        (
            '<!DOCTYPE a [\n<!ATTLIST b c CDATA "d">]><a><b/></a>',
            "x.xml:2: declares the attribute c of <b> in a DTD, which is not supported",
        ),
        ("<a>" * 60 + "</a>" * 60, "nested more than 50 deep"),
        ('<?xml version="1.0" encoding="x-unheard-of"?><a/>', "x.xml:1: is not valid XML: unknown encoding"),
    ],
)
def test_bad_xml_is_refused(tmp_path: Path, text: str, answer: str) -> None:
    path = tmp_path / "x.xml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read(path)
    assert answer in str(caught.value)


def test_an_undefined_entity_beside_a_dtd_is_refused(tmp_path: Path) -> None:
    # It could be defined in the DTD, which is not read; text must not vanish silently.
    path = tmp_path / "x.xml"
    path.write_text('<!DOCTYPE a SYSTEM "x.dtd">\n<a>\n1&b;2</a>')
    with pytest.raises(InputError, match=r"x\.xml:3: .*entity b"):
        read(path)


def test_defaults_of_a_dtd_do_not_multiply(tmp_path: Path) -> None:
    path = tmp_path / "x.zse"
    defaults = " ".join(f'a{i} CDATA "{"x" * 1000}"' for i in range(100))
    path.write_text(f"<!DOCTYPE a [<!ATTLIST b {defaults}>]><a>{'<b/>' * 100_000}</a>")
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="declares the attribute a0"):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 20 << 20
    finally:
        tracemalloc.stop()


def test_elements_are_counted_and_text_is_put_together_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.xml"
    path.write_text("<a>" + "b&lt;\n" * 100_000 + "</a>")
    assert read(path).text == "b<\n" * 100_000
    monkeypatch.setattr(xml, "_MOST_NODES", 100)
    path.write_text("<a>" + "<b/>" * 99 + "</a>")
    assert len(read(path).children) == 99
    path.write_text('<a c="d">' + "<b/>" * 99 + "</a>")
    with pytest.raises(InputError, match="more than 100 elements and attributes"):
        read(path)


def test_what_is_not_xml_is_not_parsed_as_such(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    for text in (b"simulation: minisim\n", "simulation: minisim\n".encode("utf-16")):
        path.write_bytes(text)
        with pytest.raises(InputError, match=r"m\.yaml: is not XML, which begins with '<', not with 's'"):
            read(path)
    path.write_bytes(' <a b="1"/>'.encode("utf-16"))
    assert read(path).attributes == {"b": "1"}
