"""Statecharts with states inside states do what an interpreter of SCXML by others does, action by action."""

import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from statemachine.engines.sync import SyncEngine
from statemachine.io import load
from statemachine.orderedset import OrderedSet

from swarmwright import Controller, InputError
from swarmwright.controllers import scxml
from swarmwright.controllers.scxml import _machine
from swarmwright.controllers.scxml._machine import _Resolved

SENSORS, ACTUATORS = ["left", "right"], ["speed", "turn"]
NUMBERS = [-0.5, 0.25, 0.5]
EVENTS = ["ping", "pong", "alarm.one"]


@pytest.fixture(autouse=True)
def _as_in_the_standard(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two places where the other interpreter, in version 3.2.2, is not that of SCXML's appendix D.

    selectTransitions sorts atomic states in document order; it takes them in the order of their entry, so
    that one that was entered anew comes after those of later regions, and loses a conflict with these.
    exitStates remembers atomic states alone in a deep history; it remembers all, so that the domain of a
    transition to the history is too large.
    """
    select, leave = SyncEngine._select_transitions, SyncEngine._prepare_exit_states

    def in_document_order(engine: SyncEngine, *arguments: Any) -> Any:
        active = engine.sm.configuration
        engine.sm.configuration = OrderedSet(sorted(active, key=lambda one: one.document_order))
        return select(engine, *arguments)

    def atomic_remembered(engine: SyncEngine, transitions: Any) -> Any:
        found = leave(engine, transitions)
        for history in (one for info in found[0] for one in info.state.history if one.type.is_deep):
            states = engine.sm.history_values[history.id]
            engine.sm.history_values[history.id] = [one for one in states if one.is_atomic]
        return found

    monkeypatch.setattr(SyncEngine, "_select_transitions", in_document_order)
    monkeypatch.setattr(SyncEngine, "_prepare_exit_states", atomic_remembered)


class Drawn:
    """A random statechart as XML."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.names: list[str] = []
        self.histories: list[str] = []
        self.parts: list[dict[str, Any]] = []
        top = [self.draw(0, "state" if self.random.random() < 0.6 else "parallel") for _ in range(2)]
        top.append(self.draw(9, "state"))
        self.top = top
        for part in self.parts:
            self.connect(part)

    def draw(self, depth: int, kind: str) -> dict[str, Any]:
        drawn = self.random
        name = f"s{len(self.names)}"
        self.names.append(name)
        part: dict[str, Any] = {"name": name, "kind": kind, "children": [], "transitions": [], "head": ""}
        self.parts.append(part)
        if depth < 3 and (kind == "parallel" or drawn.random() < 0.75 - 0.2 * depth):
            for _ in range(drawn.randint(2, 3 if depth == 0 else 2)):
                inner = "parallel" if drawn.random() < 0.2 and depth < 2 else "state"
                part["children"].append(self.draw(depth + 1, inner))
            if drawn.random() < 0.4:
                history = f"h{len(self.histories)}"
                self.histories.append(history)
                depth_of = drawn.choice(["shallow", "deep"])
                target = drawn.choice(part["children"])["name"]
                if kind == "state":
                    part["head"] += (
                        f'<history id="{history}" type="{depth_of}"><transition target="{target}"/></history>'
                    )
                else:
                    self.histories.pop()
            if kind == "state":
                # Given in any case: the other interpreter enters states before parallel ones.
                first = part["children"][0]["name"]
                target, actions = first, ""
                if drawn.random() < 0.4:
                    target, actions = drawn.choice(part["children"])["name"], self.actions()
                part["head"] += f'<initial><transition target="{target}">{actions}</transition></initial>'
            if kind == "state" and drawn.random() < 0.4:
                final = f"s{len(self.names)}"
                self.names.append(final)
                part["tail"] = f'<final id="{final}"><onentry>{self.actions()}</onentry></final>'
                self.parts[-1].setdefault("done", name)
                part["final"] = name
        return part

    def actions(self) -> str:
        text = ""
        for name in ACTUATORS:
            if self.random.random() < 0.35:
                text += f'<assign location="{name}" expr="{self.random.choice(NUMBERS)}"/>'
        if self.random.random() < 0.05:
            text += f'<raise event="{self.random.choice(EVENTS)}"/>'
        if self.random.random() < 0.03:
            text += f'<send event="{self.random.choice(EVENTS)}"/>'
        return text

    def condition(self) -> str:
        drawn = self.random
        tests = []
        for _ in range(drawn.randint(1, 2)):
            if drawn.random() < 0.25:
                tests.append(drawn.choice(["", "!"]) + f"(In('{drawn.choice(self.names)}'))")
            else:
                tests.append(
                    f"{drawn.choice(SENSORS)} {drawn.choice(['<', '<=', '>', '>='])} {drawn.choice(NUMBERS)}"
                )
        return drawn.choice([" && ", " || "]).join(tests)

    def connect(self, part: dict[str, Any]) -> None:
        drawn = self.random
        index = self.names.index(part["name"])
        for _ in range(drawn.randint(1, 2) if part["children"] else drawn.randint(1, 3)):
            what = drawn.random()
            targets = [*self.names, *self.histories]
            if what < 0.6:
                head = 'event="step" '
            elif what < 0.85:
                waited = [
                    *EVENTS,
                    "alarm",
                    "*",
                    *(f"done.state.{p['final']}" for p in self.parts if "final" in p),
                ]
                head = f'event="{drawn.choice(waited)}" '
            else:
                # Without an event, of inner states, and only forward, so that few go in a circle.
                head, targets = "", [] if part["children"] else self.names[index + 1 :]
            if drawn.random() < 0.85 and targets:
                target = drawn.choice(targets)
                head += f'target="{target}" '
                # The other interpreter refuses internal transitions that lead out of their state.
                if drawn.random() < 0.4 and target in inside(part):
                    head += 'type="internal" '
            elif not head:
                continue
            if drawn.random() < 0.8 or "event" not in head:
                head += f"cond={quoteattr(self.condition())}"
            # The other interpreter does the actions of a transition to a history twice.
            actions = "" if 'target="h' in head else self.actions()
            part["transitions"].append(f"<transition {head}>{actions}</transition>")

    def xml(self, part: dict[str, Any]) -> str:
        inner = "".join(self.xml(child) for child in part["children"])
        entry, leave = self.actions(), self.actions()
        return (
            f'<{part["kind"]} id="{part["name"]}"><onentry>{entry}</onentry><onexit>{leave}</onexit>'
            "<!-- first -->"
            f"{part['head']}{''.join(part['transitions'])}{inner}{part.get('tail', '')}</{part['kind']}>"
        )

    def text(self) -> str:
        waits = "".join(f'<onexit><raise event="{event}"/></onexit>' for event in EVENTS)
        waits += "".join(f'<transition event="{event}"/>' for event in EVENTS)
        body = "".join(self.xml(part) for part in self.top)
        # All events are given and waited for somewhere, so that none is a mistake.
        return f'{body}<state id="waiting">{waits}</state>'


def _all(states: Any) -> Iterator[Any]:
    for one in states:
        yield from (one, *_all(one.states), *_all(one.history))


def inside(part: dict[str, Any]) -> list[str]:
    """Return the names of all states inside of one."""
    return [name for child in part["children"] for name in (child["name"], *inside(child))]


def written(folder: Path, states: str, attributes: str = "") -> Path:
    path = folder / "chart.scxml"
    path.write_text(
        f'<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" {attributes}>{states}</scxml>'
    )
    return path


class Reference:
    """The same chart in python-statemachine; its data say what was assigned, in order."""

    def __init__(self, states: str) -> None:
        for name in ACTUATORS:
            head = f'<assign location="{name}" expr="'
            parts = states.split(head)
            for index, part in enumerate(parts[1:], 1):
                value, rest = part.split('"/>', 1)
                parts[index] = f'<assign location="trace" expr="trace + [(\'{name}\', {value})]"/>{rest}'
            states = "".join(parts)
        # Sensors get their values with the event of a control step, not before, and have none at the start:
        # the condition of each state's first transition, which does not hold, sets them.
        states = states.replace("<!-- first -->", '<transition event="step" cond="begin()"/>')
        pieces = states.split("cond=")
        for index, piece in enumerate(pieces[1:], 1):
            quote = piece[0]
            text, rest = piece[1:].split(quote, 1)
            text = text.replace("!(", "not (")
            if text == "begin()":
                continue
            known = "known == 1 and " if any(name in text for name in SENSORS) else ""
            pieces[index] = f"{quote}{known}({text}){quote}{rest}"
        states = "cond=".join(pieces)
        data = '<data id="trace" expr="[]"/><data id="known" expr="0"/>'
        data += "".join(f'<data id="{name}" expr="0"/>' for name in SENSORS)
        # It sets data anew whenever the initial state is entered.
        text = (
            '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" initial="boot">'
            f'<datamodel>{data}</datamodel>{states}<state id="boot"><transition target="s0"/></state></scxml>'
        )
        chart = load(text, format="scxml", trusted=True)
        ids = {one.id: one for one in _all(chart.states)}
        # It numbers inner states anew in each state, where SCXML counts them through the document.
        for order, one in enumerate(re.findall(r'<(?:state|parallel|final|history) id="(\w+)"', states), 1):
            ids[one].document_order = order
        self.machine = chart()
        self.values = [0.0, 0.0]
        self.machine.model.begin = self.begin

    def begin(self) -> bool:
        self.machine.model.known = 1
        for name, value in zip(SENSORS, self.values, strict=True):
            setattr(self.machine.model, name, value)
        return False

    def taken(self) -> list[tuple[str, float]]:
        trace = list(self.machine.model.trace)
        self.machine.model.trace = []
        return trace

    def step(self, values: Any) -> list[tuple[str, float]]:
        self.values = [float(value) for value in values]
        self.machine.model.known = 0
        self.machine.send("step")
        return self.taken()


def flattened(path: Path) -> tuple[Any, Any]:
    """Return the steps of a chart for every combination of sensors, and thresholds of these."""
    machine = scxml.read(path)
    resolved = _Resolved(machine, SENSORS, ACTUATORS)
    steps, thresholds, _ = _machine.build_steps(machine.root, *resolved.parts(), len(SENSORS))
    return steps, thresholds


@pytest.mark.parametrize("seed", [*range(22), 38, 147])
def test_random_charts_do_what_another_interpreter_does(tmp_path: Path, seed: int) -> None:
    states = Drawn(seed).text()
    path = written(tmp_path, states, 'initial="s0"')
    try:
        controller = Controller(scxml.read(path).specification(SENSORS, ACTUATORS))
    except InputError as error:
        assert "form an endless loop" in str(error) or "more than 1000 combinations" in str(error)  # noqa: PT017
        pytest.skip("goes in a circle, or is too large")
    steps, thresholds = flattened(path)
    reference = Reference(states)
    snapshot, first = steps.begin()
    begun = reference.taken()
    assert [(ACTUATORS[number], value) for number, value in first] == begun
    outputs = dict.fromkeys(ACTUATORS, 0.0) | dict(begun)
    drawn = np.random.default_rng(seed)
    for _ in range(60):
        values = drawn.choice(np.array([-0.6, -0.5, 0.0, 0.25, 0.3, 0.5, 0.9], np.float32), 2)
        expected = reference.step(values)
        row = 0
        for sensor in range(2):
            ends = thresholds[sensor]
            row = row * (len(ends) + 1) + int(np.searchsorted(ends, values[sensor]))
        [(snapshot, done)] = [(after, done) for rows, after, done in steps.step(snapshot) if row in rows]
        assert [(ACTUATORS[number], value) for number, value in done] == expected
        outputs |= dict(expected)
        assert controller(values).tolist() == [outputs[name] for name in ACTUATORS]


@pytest.mark.slow
def test_a_chart_with_too_many_states_is_refused_with_their_number(tmp_path: Path) -> None:
    region = (
        '<state id="r{0}">'
        '<state id="r{0}a"><transition event="step" cond="left &gt; 0.{0}" target="r{0}b"/></state>'
        '<state id="r{0}b"><transition event="step" cond="right &gt; 0.{0}" target="r{0}a"/></state>'
        "</state>"
    )
    regions = "".join(region.format(index) for index in range(1, 14))
    path = written(tmp_path, f'<parallel id="all">{regions}</parallel>')
    with pytest.raises(InputError, match=r"reachable \(8,192 combinations of states in the file\)"):
        scxml.read(path).specification(SENSORS, ACTUATORS)


CONFLICT = """
    <parallel id="both">
      <state id="first"><initial><transition target="again"/></initial>
        <state id="again"><transition event="step" target="again">
          <assign location="turn" expr="0.5"/></transition></state></state>
      <state id="second"><transition event="step" target="elsewhere"/></state>
    </parallel>
    <state id="elsewhere"><onentry><assign location="speed" expr="1"/></onentry></state>"""
"""Both regions want to leave `again`: the first one in the document wins, in every step."""
DEEP = """
    <state id="outer">
      <history id="before" type="deep"><transition target="start"/></history>
      <initial><transition target="start"/></initial>
      <state id="start"><transition event="step" target="inner"/></state>
      <state id="around"><onexit><assign location="speed" expr="1"/></onexit>
        <initial><transition target="inner"/></initial>
        <state id="inner">
          <transition event="step" cond="left &gt; 0.5" target="before">
            <assign location="turn" expr="0.5"/></transition>
          <transition event="step" target="away"/></state></state>
    </state>
    <state id="away"><onentry><assign location="speed" expr="0"/></onentry>
      <transition event="step" target="before"/></state>"""
"""`before` remembers `inner` alone, an atomic state: a transition from there does not leave `around`."""


@pytest.mark.parametrize(
    ("states", "steps"),
    [
        (CONFLICT, [(0, [0, 0.5]), (0, [0, 0.5]), (0, [0, 0.5])]),
        (DEEP, [(0, [0, 0]), (0, [0, 0]), (0, [0, 0]), (1, [0, 0.5]), (0, [0, 0.5])]),
    ],
    ids=["order of regions", "deep history"],
)
def test_what_other_interpreters_do_otherwise(
    tmp_path: Path, states: str, steps: list[tuple[float, list[float]]]
) -> None:
    """As SCXML's appendix D has it; these are shrunk charts that another interpreter took differently."""
    machine = Controller(scxml.read(written(tmp_path, states)).specification(SENSORS, ACTUATORS))
    for left, expected in steps:
        assert machine([left, 0]).tolist() == expected


def test_regions_take_steps_together(tmp_path: Path) -> None:
    """A region that drives, one that turns, and an alarm that ends both, in one control step."""
    states = """
    <parallel id="work">
      <state id="drive">
        <state id="slow"><onentry><assign location="speed" expr="0.25"/></onentry>
          <transition cond="left &gt; 0.5 &amp;&amp; !(In('around'))" target="fast"/></state>
        <state id="fast"><onentry><assign location="speed" expr="1"/></onentry>
          <transition cond="In('around')" target="slow"/></state>
      </state>
      <state id="steer">
        <state id="ahead"><onentry><assign location="turn" expr="0"/></onentry>
          <transition cond="right &gt; 0.5" target="around"/></state>
        <state id="around"><onentry><assign location="turn" expr="-1"/></onentry>
          <transition cond="right &lt;= 0.5" target="ahead"/>
          <transition event="step" cond="left &lt; 0"><raise event="alarm"/></transition></state>
      </state>
      <transition event="alarm" target="stopped"/>
    </parallel>
    <final id="stopped"><onentry><assign location="speed" expr="0"/></onentry></final>"""
    machine = Controller(scxml.read(written(tmp_path, states)).specification(SENSORS, ACTUATORS))
    for sensors, expected in [
        ([0, 0], [0.25, 0]),
        ([1, 0], [1, 0]),
        ([1, 1], [0.25, -1]),
        ([0, 1], [0.25, -1]),
        ([-1, 1], [0, -1]),
        ([1, 0], [0, -1]),
    ]:
        assert machine(sensors).tolist() == expected, sensors
