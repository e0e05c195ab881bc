"""State machines do what SCXML says, as controllers of the engine."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest

from swarmwright import Controller, InputError
from swarmwright.common.xml import Element
from swarmwright.common.xml import read as read_xml
from swarmwright.controllers import scxml

NUMBERS = [-1.0, -0.5, 0.0, 0.1, 0.2, 0.5, 1.0]
SENSORS, ACTUATORS = ["left", "right"], ["speed", "turn"]


def written(folder: Path, states: str, attributes: str = "", data: str = "") -> Path:
    path = folder / "machine.scxml"
    path.write_text(
        f'<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" {attributes}>{data}{states}</scxml>'
    )
    return path


def controller(path: Path) -> Controller:
    return Controller(scxml.read(path).specification(SENSORS, ACTUATORS))


class Interpreter:
    """A few lines that follow SCXML's algorithm, in double precision, for machines without bad names."""

    def __init__(self, path: Path) -> None:
        self.root = read_xml(path)
        self.states = {one.attributes["id"]: one for one in self.root.find_all("state")}
        self.values = dict.fromkeys(ACTUATORS, 0.0)
        self.at = self.root.attributes.get("initial", next(iter(self.states)))
        self._run(self.states[self.at].find_all("onentry"))

    def _run(self, blocks: list[Element]) -> None:
        for block in blocks:
            for one in block.find_all("assign"):
                self.values[one.attributes["location"]] = float(one.attributes["expr"])

    def _take(self, one: Element) -> None:
        target = one.attributes.get("target")
        self._run(self.states[self.at].find_all("onexit") if target else [])
        self._run([one])
        if target:
            self.at = target
            self._run(self.states[target].find_all("onentry"))

    def _enabled(self, sensors: dict[str, float], *, event: bool) -> Element | None:
        for one in self.states[self.at].find_all("transition"):
            condition = one.attributes.get("cond", "True").replace("&&", " and ").replace("||", " or ")
            if ("event" in one.attributes) == event and eval(condition, {}, sensors):
                return one
        return None

    def step(self, values: np.ndarray[Any, Any]) -> list[float]:
        sensors = dict(zip(SENSORS, map(float, values), strict=True))
        if (one := self._enabled(sensors, event=True)) is not None:
            self._take(one)
        while (one := self._enabled(sensors, event=False)) is not None:
            self._take(one)
        return [self.values[name] for name in ACTUATORS]


def random_machine(seed: int) -> str:
    """A machine with events, without, with actions everywhere; those without an event only lead forward."""
    drawn = random.Random(seed)
    names = ["a", "b", "c"]

    def comparison() -> str:
        sides = [drawn.choice(SENSORS), repr(drawn.choice(NUMBERS))]
        drawn.shuffle(sides)
        return f" {drawn.choice(['<', '<=', '>', '>=', '==', '!='])} ".join(sides)

    def condition() -> str:
        text = drawn.choice([" && ", " || "]).join(comparison() for _ in range(drawn.randint(1, 3)))
        return text if drawn.random() < 0.7 else f"({text}) && {comparison()}"

    def actions() -> str:
        chosen = [name for name in ACTUATORS if drawn.random() < 0.4]
        return "".join(f'<assign location="{name}" expr="{drawn.choice(NUMBERS)}"/>' for name in chosen)

    text = ""
    for index, name in enumerate(names):
        transitions = ""
        for _ in range(drawn.randint(0, 3)):
            event = drawn.random() < 0.6
            targets = [*names, None] if event else names[index + 1 :]
            if not targets:
                continue
            target = drawn.choice(targets)
            head = 'event="step" ' * event + (f'target="{target}" ' if target else "")
            transitions += f"<transition {head}cond={quoteattr(condition())}>{actions()}</transition>"
        blocks = f"<onentry>{actions()}</onentry><onexit>{actions()}</onexit>"
        text += f'<state id="{name}">{blocks}{transitions}</state>'
    return text


@pytest.mark.parametrize("seed", range(60))
def test_random_machines_do_what_an_interpreter_does(tmp_path: Path, seed: int) -> None:
    path = written(tmp_path, random_machine(seed), 'initial="b"' if seed % 2 else "")
    machine, expected = controller(path), Interpreter(path)
    drawn = np.random.default_rng(seed)
    near = [
        np.float32(x)
        for one in NUMBERS
        for x in (one, np.nextafter(np.float32(one), np.float32(9)), one - 0.05)
    ]
    for _ in range(200):
        sensors = drawn.choice(near, 2).astype(np.float32)
        assert machine(sensors).tolist() == np.array(expected.step(sensors), np.float32).tolist()


def test_actuators_keep_their_numbers(tmp_path: Path) -> None:
    states = """
    <state id="wait"><onentry><assign location="speed" expr="0.25"/></onentry>
      <transition cond="left &gt; 0" target="go"/></state>
    <state id="go"><onentry><send event="x"><param name="turn" expr="-1"/></send></onentry></state>"""
    machine = controller(written(tmp_path, states))
    assert machine([0, 0]).tolist() == [0.25, 0]
    assert machine([1, 0]).tolist() == [0.25, -1]
    assert machine([0, 0]).tolist() == [0.25, -1]


def test_names_are_found_however_they_are_written(tmp_path: Path) -> None:
    states = """<state id="a">
      <transition cond="_event.data.goal_x &gt; limit" target="b"/>
      <transition cond="sensors[1] &gt;= limit * 2" target="b"/></state>
    <state id="b"><onentry><assign location="move_x" expr="limit"/></onentry>
      <transition event="goal.x" target="a"/></state>"""
    path = written(tmp_path, states, data='<datamodel><data id="limit" expr="0.5"/></datamodel>')
    made = scxml.read(path).specification(["goal x", "Goal-Y"], ["move x"])
    assert made["thresholds"] == [[0.0, 0.5], [0.99999994]]
    assert Controller(made)([0, 1]).tolist() == [0.5]
    assert Controller(made)([0.5, 0.9]).tolist() == [0.0]


def test_a_file_may_declare_its_sensors_and_actuators(tmp_path: Path) -> None:
    states = """<state id="a"><transition event="step" cond="near &lt; 0.5">
      <assign location="turn" expr="1"/></transition></state>"""
    data = '<datamodel><data id="far"/><data id="near"/><data id="turn" expr="-0.5"/></datamodel>'
    made = scxml.read(written(tmp_path, states, data=data))
    assert (made.sensors, made.assigned) == (["far", "near"], ["turn"])
    machine = Controller(made.specification())
    assert machine([0, 0.7]).tolist() == [-0.5]
    assert machine([0, 0]).tolist() == [1]


@pytest.mark.parametrize(
    ("states", "answer"),
    [
        ("", "<scxml>: has no states"),
        ('<state id="a"/><state id="a"/>', r"duplicate id 'a' \(first in line 1\)"),
        ("<state/>", "the attribute id is missing"),
        ('<state id="a"><transition event="step" target="c"/></state>', "target: unknown state 'c'"),
        ('<state id="a"><transition target="a"/></state>', "'a' form an endless loop"),
        ('<state id="a"><transition event="left x" target="a"/></state>', "unknown event 'x'; available: "),
        (
            '<state id="a"><transition event="found" target="a"/></state>',
            "unknown event 'found'; available: .*step",
        ),
        (
            '<state id="a"><transition event="lift" target="a"/></state>',
            "unknown event 'lift'; did you mean 'left'",
        ),
        ('<state id="a"><transition cond="lft > 1"/></state>', "unknown sensor 'lft'; did you mean 'left'"),
        ('<state id="a"><transition cond="left > right"/></state>', "'right' found, expected a number"),
        (
            '<state id="a"><transition cond="left"/></state>',
            "expected a comparison of a sensor with a number",
        ),
        ('<state id="a"><transition cond="left + 1 > 2"/></state>', "expected a comparison of a sensor"),
        ('<state id="a"><transition cond="0 &lt; left &lt; 1"/></state>', "write two comparisons"),
        (
            '<state id="a"><transition cond="!left > 1"/></state>',
            r"put the negated expression in brackets, !\(..\)",
        ),
        ('<state id="a"><transition cond="left >"/></state>', "'left >' is not a valid expression"),
        ('<state id="a"><transition cond="__import__(1) > 1"/></state>', "expected a comparison"),
        ('<state id="a"><transition cond="left > 1/0"/></state>', "divides by zero"),
        ('<state id="a"><transition cond="left > 1e99"/></state>', "is not a finite number"),
        (
            '<state id="a"><transition cond="sensors[7] > 1"/></state>',
            r"sensors\[7\] does not exist; there are 2 sensors",
        ),
        ('<state id="a"><transition cond="left > 0" target="a"/></state>', "'a' form an endless loop"),
        (
            '<state id="a"><onentry><assign location="speed" expr="2"/></onentry></state>',
            "2 found, expected -1 to",
        ),
        (
            '<state id="a"><onentry><assign location="sped" expr="1"/></onentry></state>',
            "did you mean 'speed'",
        ),
        ('<state id="a"><onentry><assign expr="1"/></onentry></state>', "location is missing"),
        ('<state id="a"><onentry><assign location="speed"/></onentry></state>', "expr is missing"),
        ('<state id="a"><onentry><send event="x"/></onentry></state>', "no transition waits for 'x'"),
        ('<state id="a"><onentry><send/></onentry></state>', "is empty; expected an event, or <param"),
        ('<state id="a"><onentry><if cond="1"/></onentry></state>', "<if>: is not supported"),
        (
            '<state id="a"><invoke type="ROS_ACTION"/></state>',
            "<invoke>: controllers cannot call ROS actions",
        ),
        ('<parallel id="a"/>', "has no states inside; expected two or more"),
        ('<state id="a"><history id="h"/><state id="b"/></state>', "has no default; add <transition target"),
        (
            '<state id="a" initial="c"><state id="b"/></state><state id="c"/>',
            "<state>: initial: 'c' is not inside 'a'",
        ),
        (
            '<state id="a"><transition event="step" target="b c"/></state><state id="b"/><state id="c"/>',
            "'b' and 'c' cannot be entered together",
        ),
        (
            '<state id="a"><transition event="step" cond="In(\'bb\')"/></state><state id="b"/>',
            "In\\('bb'\\): unknown state 'bb'; did you mean 'b'",
        ),
        ('<state id="a"><onentry><raise/></onentry></state>', "<raise>: the attribute event is missing"),
        ('<state id="a"><onentry><raise event="step"/></onentry></state>', "reserved for control steps"),
        (
            '<state id="a"><onentry><send event="x" delay="1s"/></onentry></state>',
            "delay: is not supported; count control steps with states",
        ),
        (
            '<state id="a"><onentry><send event="x" target="b"/></onentry></state>',
            "target 'b' is not supported",
        ),
        ('<final id="a"><transition event="step"/></final>', "<transition>: found inside; expected onentry"),
        ('<final id="a"><state id="b"/></final>', "<state>: cannot be inside of <final>"),
        ('<state id="a"><transition event="step" type="inner"/></state>', "expected external or internal"),
        ('<stat id="a"/>', "<stat>: found inside; expected .*did you mean 'state'"),
    ],
)
def test_what_is_not_supported_is_named(tmp_path: Path, states: str, answer: str) -> None:
    path = written(tmp_path, states)
    with pytest.raises(InputError, match=answer) as caught:
        scxml.read(path).specification(SENSORS, ACTUATORS)
    assert str(path) in str(caught.value)


def test_modelios_missing_slash_is_named(tmp_path: Path) -> None:
    path = tmp_path / "modelio.scxml"
    path.write_text(
        '<scxml version="1.0" initial="a">\n<state id= "a">\n<transition event="left" target="b"/>\n<state>\n'
        '<state id= "b">\n<state>\n</scxml>\n'
    )
    with pytest.raises(InputError, match=r"modelio\.scxml:4: <state> found where </state> is expected"):
        scxml.read(path)
    path.write_text('<scxml>\n<state id="a">\n</scxml>')
    with pytest.raises(InputError, match=r"modelio\.scxml:3: is not valid XML: mismatched tag"):
        scxml.read(path)


def test_a_table_that_is_too_large_is_refused(tmp_path: Path) -> None:
    tests = (" || ".join(f"{name} == {number / 4}" for number in range(300)) for name in SENSORS)
    transitions = "".join(f'<transition event="step" cond="{test}" target="a"/>' for test in tests)
    states = f'<state id="a">{transitions}</state>'
    with pytest.raises(InputError, match=r"the table has \d+ numbers, but the limit is 1000000"):
        controller(written(tmp_path, states))


def test_conditions_are_exact_at_every_float32(tmp_path: Path) -> None:
    compare: dict[str, Callable[[float, float], bool]] = {
        ">": lambda x, y: x > y,
        ">=": lambda x, y: x >= y,
        "<": lambda x, y: x < y,
        "<=": lambda x, y: x <= y,
        "==": lambda x, y: x == y,
    }
    for bound in (0.1, 0.0, 0.5, -1e-45, 3e38, 16777217.0):
        around = [np.float32(bound)]
        for way in (np.inf, -np.inf):
            around += [np.nextafter(around[0], np.float32(way))]
        for sign, holds in compare.items():
            condition = quoteattr(f"left {sign} {bound!r}")
            actions = '<assign location="speed" expr="1"/>'
            transition = f'<transition event="step" cond={condition}>{actions}</transition>'
            machine = controller(written(tmp_path, f'<state id="a">{transition}</state>'))
            for value in around:
                machine.reset()
                found = machine(np.array([value, 0], np.float32)).tolist()[0]
                assert found == holds(float(value), bound), (bound, sign, value)


def named_machine(
    folder: Path, condition: str, actuator: str = "speed", data: str = ""
) -> scxml.StateMachine:
    states = (
        f'<state id="a"><transition event="step" cond={quoteattr(condition)} target="b"/></state>'
        f'<state id="b"><onentry><assign location={quoteattr(actuator)} expr="1"/></onentry></state>'
    )
    path = folder / "machine.scxml"
    head = '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0">'
    path.write_text(f"{head}<datamodel>{data}</datamodel>{states}</scxml>", encoding="utf-8")
    return scxml.read(path)


@pytest.mark.parametrize(
    ("condition", "sensors", "index"),
    [
        ("απόσταση > 0.5", ["ταχύτητα", "Απόσταση"], 1),
        ("höhe > 0.5", ["höhe", "hühe"], 0),
        ("hühe > 0.5", ["höhe", "hühe"], 1),
        ("a_b > 0.5", ["a b", "a_b"], 1),
        ("goalX > 0.5", ["goal y", "goal x"], 1),
        ("sensors[1] > 0.5", ["light+", "light-"], 1),
    ],
)
def test_names_stand_for_one_sensor(tmp_path: Path, condition: str, sensors: list[str], index: int) -> None:
    made = named_machine(tmp_path, condition).specification(sensors, ["speed"])
    assert [len(ends) for ends in made["thresholds"]] == [int(one == index) for one in range(2)]


def test_ambiguous_names_are_refused(tmp_path: Path) -> None:
    machine = named_machine(tmp_path, "light > 0.5", "motor")
    with pytest.raises(InputError) as caught:
        machine.specification(["light+", "light-"], ["motor 1", "motor-", "motor+"])
    told = str(caught.value)
    assert "the sensor 'light' is ambiguous: 'light+' or 'light-'; write sensors[0] or sensors[1]" in told
    assert "the actuator 'motor' is ambiguous: 'motor-' or 'motor+'; write actuators[1] or" in told
    with pytest.raises(InputError, match="unknown sensor 'höhe'"):
        named_machine(tmp_path, "höhe > 0.5").specification(["hühe", "hohe"], ["speed"])
    # Python's parser makes the second of the first, U+00B5 and U+03BC.
    with pytest.raises(InputError, match="the sensor 'μ' is ambiguous: 'µ' or 'μ'"):
        named_machine(tmp_path, "µ > 0.5").specification(["µ", "μ"], ["speed"])
    with pytest.raises(InputError, match="the ids 'µ' and 'μ' are equal in expressions"):
        named_machine(tmp_path, "µ > 0.5", data='<data id="µ"/><data id="μ"/>')


NAMES = [
    ["light+", "light-", "light"],
    ["goal x", "goal-x", "Goal X"],
    ["a1 1", "a 11", "a11"],
    ["x", "x_2", "x 2"],
    ["a b", "a_b", "a_b_2"],
    ["true", "state0", "In"],
    ["απόσταση", "ταχύτητα", "höhe"],
    ["+", "-", "*"],
]


@pytest.mark.parametrize("names", NAMES)
def test_what_was_exported_is_read_by_the_names_of_the_simulation(tmp_path: Path, names: list[str]) -> None:
    drawn = np.random.default_rng(1)
    table = [[drawn.integers(0, 2), *drawn.uniform(-1, 1, 2)] for _ in range(2 * 12)]
    made = {
        "version": 1,
        "kind": "mealy_fsm",
        "sensors": 3,
        "actuators": 2,
        "states": 2,
        "thresholds": [[0.25], [-0.5, 0.5], [0.75]],
        "weights": [float(np.float32(one)) for row in table for one in row],
    }
    actuators = ["motor+", "motor-"]
    path = tmp_path / "exported.scxml"
    path.write_text(scxml.to_scxml(made, names, actuators), encoding="utf-8")
    machine = scxml.read(path)
    assert machine.specification(names, actuators) == machine.specification()
    first, second = Controller(made), Controller(machine.specification(names, actuators))
    for sensors in drawn.uniform(-1, 1, (300, 3)).astype(np.float32):
        assert first(sensors).tolist() == second(sensors).tolist()


def test_data_may_have_their_value_inside(tmp_path: Path) -> None:
    data = '<data id="near">\n  0.25 * 2\n</data><data id="speed">-0.5</data>'
    made = named_machine(tmp_path, "left > near", data=data).specification(["left"], ["speed"])
    assert made["thresholds"] == [[0.5]]
    assert Controller(made)([0.0]).tolist() == [-0.5]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ('<data id="near" src="near.json"/>', "<data>: src: is not supported; write the number, <data id="),
        ('<data id="near" expr="1">2</data>', "<data>: has both the attribute expr and '2' inside; keep one"),
        ('<data id="near"><x/></data>', "<data>: <x> found inside; expected a number"),
        ('<data id="near">far away</data>', "<data>: content: 'far away' is not a valid expression"),
    ],
)
def test_other_values_of_data_are_refused(tmp_path: Path, data: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        named_machine(tmp_path, "left > near", data=data)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("left > 0.5 # && right > 0", "comments are not supported"),
        ("!(left > 0.5) == true", r"!\(left > 0.5\) is negated before the comparison"),
        ("right > 0 && !( (left) ) < 0.5", r"!\( \(left\) \) is negated before"),
        ("!(left) !== 1", "is negated before"),
    ],
)
def test_what_ecmascript_reads_otherwise_is_refused(tmp_path: Path, condition: str, message: str) -> None:
    with pytest.raises(InputError, match=f"cond: .*{message}"):
        named_machine(tmp_path, condition)


def test_a_sign_in_a_string_and_negated_comparisons_are_read(tmp_path: Path) -> None:
    made = named_machine(tmp_path, "!(left > 0.5) && (right < 0 || !(In('#)')))")
    with pytest.raises(InputError, match=r"unknown state '#\)'"):
        made.specification(SENSORS, ["speed"])


PREFIXED = """<sc:scxml xmlns:sc="http://www.w3.org/2005/07/scxml" xmlns:qt="{space}" version="1.0">
  <sc:datamodel><sc:data id="near" expr="0.5"/></sc:datamodel>
  <qt:editorinfo initialGeometry="1"/>
  <sc:state id="a">
    <sc:transition event="step" cond="left &gt; near" target="b">{inside}</sc:transition>
  </sc:state>
  <sc:state id="b"><sc:onentry><sc:assign location="speed" expr="1"/></sc:onentry></sc:state>
</sc:scxml>"""
QT, OTHER = "http://www.qt.io/2015/02/scxml-ext", "http://example.org/robots"


def test_prefixes_and_notes_of_editors_do_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "machine.scxml"
    path.write_text(PREFIXED.format(space=QT, inside='<qt:editorinfo movePoint="1;2"/>'))
    made = scxml.read(path).specification(["left"], ["speed"])
    assert (made["states"], made["thresholds"]) == (2, [[0.5]])
    path.write_text(path.read_text().replace("sc:", "").replace("xmlns:sc", "xmlns"))
    assert scxml.read(path).specification(["left"], ["speed"]) == made
    path.write_text(PREFIXED.format(space=OTHER, inside=""))
    assert scxml.read(path).specification(["left"], ["speed"]) == made
    path.write_text(PREFIXED.format(space=OTHER, inside="<qt:drive/>"))
    with pytest.raises(
        InputError, match=r":5: <qt:drive>: elements of http://example.org/robots are not supported"
    ):
        scxml.read(path)
