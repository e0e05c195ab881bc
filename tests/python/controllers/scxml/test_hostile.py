"""Large and hostile files are read, or refused, in a time that grows with their size alone."""

import time
from pathlib import Path

import pytest

from swarmwright import InputError
from swarmwright.controllers import scxml

MANY = 10_000


def many(line: str) -> str:
    return "".join(line.replace("N", str(index)) for index in range(MANY))


DATA = many("<data id='dN' expr='1'/>")
EVENTS = many("<raise event='eN.x'/>"), many("<transition event='eN' target='a'/>")
REGIONS = many("<state id='sN'/>")
ENTERED = f"<state id='a'><transition target='{many('sN ')}'/></state>"


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("<state>" + "<state " * 100_000, "is not valid XML"),
        (f"<datamodel>{DATA}</datamodel><state id='a'/>", None),
        (f"<state id='a'><onentry>{EVENTS[0]}</onentry>{EVENTS[1]}</state>", None),
        (f"<parallel id='p'>{REGIONS}</parallel>{ENTERED}", None),
        (f"<state id='a'><transition target='{'a ' * MANY}'/></state>", "cannot be entered together"),
        (many("<state id='sN'><transition target='bN'/></state>"), "these are the first 100"),
        (many("<stte id='sN'/>\n"), "these are the first 100"),
        (f"<state id='a'><transition cond='{'!(' * 4000}' target='a'/></state>", "not a valid expression"),
    ],
)  # fmt: skip
def test_time_grows_with_the_size_alone(text: str, answer: str | None, tmp_path: Path) -> None:
    path = tmp_path / "machine.scxml"
    path.write_text(f'<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0">{text}</scxml>')
    before = time.process_time()
    if answer is None:
        scxml.read(path)
    else:
        with pytest.raises(InputError, match=answer) as caught:
            scxml.read(path)
        assert len(str(caught.value)) < 50_000
    assert time.process_time() - before < 20  # some took minutes


@pytest.mark.parametrize(
    ("actions", "answer"),
    [
        ("<raise event='e'/>" * 200, "more than 10000 events are queued"),
        (
            "<raise event='e'/>" * 3 + "<assign location='turn' expr='0'/>" * 5000,
            "assigns more than 100000 numbers",
        ),
    ],
)
def test_steps_that_grow_are_refused(actions: str, answer: str, tmp_path: Path) -> None:
    path = tmp_path / "machine.scxml"
    path.write_text(
        "<scxml version='1.0'><state id='a'><transition event='step' target='b'/></state>"
        f"<state id='b'><onentry>{actions}</onentry><transition event='e' target='c'/></state>"
        "<state id='c'><transition target='b'/></state></scxml>"
    )
    with pytest.raises(InputError, match=answer):
        scxml.read(path).specification(["near"], ["turn"])


@pytest.mark.parametrize("number", ["9" * 400, "9" * 5000, "0x" + "F" * 800, "0x" + "F" * 5000])
def test_numbers_that_are_too_large_are_refused(number: str, tmp_path: Path) -> None:
    path = tmp_path / "machine.scxml"
    path.write_text(
        f'<scxml version="1.0"><datamodel>\n<data id="d" expr="{number}"/></datamodel><state id="a"/></scxml>'
    )
    with pytest.raises(InputError, match=r"machine\.scxml:2: <data>: expr: .*(finite number|1000 char)"):
        scxml.read(path)
