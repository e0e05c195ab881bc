"""SCXML files: what is in them, and what of it is not supported."""

import ast
import re
from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.core.files import read_bytes
from swarmwright.core.suggestions import did_you_mean
from swarmwright.core.xml import Element
from swarmwright.core.xml import read as read_xml
from swarmwright.scxml._conditions import ConditionError, constant, parse
from swarmwright.scxml._machine import Assignment, State, StateMachine, Transition

EVENT = "step"
"""The event of each control step, at which sensors have new values."""
_EVENTS = frozenset({EVENT, "*"})
_BARE = re.compile(rb"<state\s*>")
_LARGEST = 1 << 28
_IGNORED = frozenset({"log"})
_INSTEAD = {
    "invoke": 'actions of ROS are not computed by controllers; assign actuators: <assign location="heading" '
    'expr="0.5"/>',
    "parallel": "states that are active at the same time are not supported; draw one machine for each agent",
    "state": "states inside states are not supported; draw them side by side",
    "history": "is not supported",
    "if": "is not supported; take a transition with the condition",
    "script": "is not supported; assign actuators",
}


def read(path: Path) -> StateMachine:
    """Read a state machine.

    Raises InputError with everything that is wrong or not supported, file and line each.
    """
    try:
        root = read_xml(path)
    except InputError as error:
        raise InputError(_not_closed(path) or str(error)) from error
    return _Reader(path, root).machine()


def _not_closed(path: Path) -> str | None:
    """Return what is wrong with a file in which `<state>` stands for `</state>`; None for another one."""
    data = read_bytes(path, _LARGEST)
    found = _BARE.search(data)
    if found is None or data.count(b"</state") >= len(re.findall(rb"<state\s[^>]*[^/]>", data)):
        return None
    line = data.count(b"\n", 0, found.start()) + 1
    return (
        f"{path}:{line}: <state> found where </state> is expected; a version of Modelio's CPSwarm module "
        "writes it so: write </state> at the end of each state"
    )


class _Reader:
    def __init__(self, path: Path, root: Element) -> None:
        self.root = root
        self.problems: list[str] = []
        self.machine_ = StateMachine(path, root.attributes.get("name", ""))

    def problem(self, element: Element, message: str) -> None:
        self.problems.append(str(element.error(message)))

    def machine(self) -> StateMachine:
        for element in self.root.children:
            if element.tag == "datamodel":
                self._data(element)
            elif element.tag in {"state", "final"}:
                self._state(element)
            else:
                self._unknown(element, ("datamodel", "final", "state"))
        self._check_targets()
        if self.problems:
            raise InputError("\n".join(self.problems))
        return self.machine_

    def _unknown(self, element: Element, expected: tuple[str, ...]) -> None:
        if element.tag in _IGNORED:
            return
        hint = _INSTEAD.get(element.tag) or (
            f"found inside; expected {', '.join(expected)}{did_you_mean(element.tag, expected)}"
        )
        self.problem(element, hint)

    def _data(self, datamodel: Element) -> None:
        for element in datamodel.children:
            name = element.attributes.get("id", "")
            if element.tag != "data" or not name:
                self.problem(element, 'found inside <datamodel>; expected <data id="NAME"/>')
            elif name in self.machine_.declared:
                self.problem(element, f"duplicate id {name!r}; keep one")
            elif "expr" in element.attributes:
                self.machine_.declared[name] = self._number(element, "expr")
            else:
                self.machine_.declared[name] = None

    def _number(self, element: Element, attribute: str) -> float:
        text = element.attributes.get(attribute)
        known = {name: value for name, value in self.machine_.declared.items() if value is not None}
        if text is None:
            self.problem(element, f"the attribute {attribute} is missing")
            return 0.0
        try:
            return constant(parse(text), known)
        except ConditionError as error:
            self.problem(element, f"{attribute}: {error}")
            return 0.0

    def _state(self, element: Element) -> None:
        name = element.attributes.get("id", "").strip()
        if not name:
            self.problem(element, "the attribute id is missing")
            return
        if name in self.machine_.states:
            first = self.machine_.states[name].line
            self.problem(element, f"duplicate id {name!r} (first in line {first}); keep one")
            return
        state = State(name, element.line)
        self.machine_.states[name] = state
        for inner in element.children:
            if inner.tag == "onentry":
                state.entry += self._actions(inner)
            elif inner.tag == "onexit":
                state.exit += self._actions(inner)
            elif inner.tag == "transition":
                state.transitions.append(self._transition(inner))
            elif inner.tag != "datamodel":  # belongs to an <invoke>, which is reported
                self._unknown(inner, ("onentry", "onexit", "transition"))

    def _transition(self, element: Element) -> Transition:
        events = element.attributes.get("event", "").split()
        named = [event for event in events if event not in _EVENTS]
        text = element.attributes.get("cond")
        tree: ast.expr | None = None
        if text is not None:
            try:
                tree = parse(text)
            except ConditionError as error:
                self.problem(element, f"cond: {error}")
        if len(named) > 1:
            self.problem(element, f"has {len(named)} events; draw one transition for each")
        target = element.attributes.get("target", "").strip() or None
        if text is None and not events:
            self.problem(
                element,
                f'has neither cond nor event; write cond="SENSOR &gt; NUMBER", or event="{EVENT}" for one '
                "that is taken in any case",
            )
        return Transition(
            element.line, bool(events), named[0] if named else None, tree, target, self._actions(element)
        )

    def _actions(self, element: Element) -> list[Assignment]:
        found: list[Assignment] = []
        for inner in element.children:
            if inner.tag == "assign":
                location = inner.attributes.get("location", "").strip()
                if not location:
                    self.problem(inner, "the attribute location is missing; it names an actuator")
                found.append(Assignment(location, self._output(inner), inner.line))
            elif inner.tag == "send":
                for parameter in inner.children:
                    name = parameter.attributes.get("name", "").strip()
                    if parameter.tag != "param" or not name:
                        self.problem(
                            parameter, 'expected <param name="ACTUATOR" expr="NUMBER"/> inside <send>'
                        )
                        continue
                    found.append(Assignment(name, self._output(parameter), parameter.line))
                if not inner.children:
                    self.problem(inner, 'is empty; expected <param name="ACTUATOR" expr="NUMBER"/> inside')
            else:
                self._unknown(inner, ("assign", "log", "send"))
        return found

    def _output(self, element: Element) -> float:
        value = self._number(element, "expr")
        if abs(value) > 1:
            self.problem(element, f"expr: {value:g} found, expected -1 to 1, the range of an actuator")
        return value

    def _check_targets(self) -> None:
        states = self.machine_.states
        if not states:
            self.problem(self.root, "has no states")
            return
        initial = self.root.attributes.get("initial", "").strip() or next(iter(states))
        if initial not in states:
            self.problem(self.root, f"initial: there is no state {initial!r}{did_you_mean(initial, states)}")
        self.machine_.initial = initial
        for state in states.values():
            for one in state.transitions:
                if one.target is not None and one.target not in states:
                    self.problems.append(
                        f"{self.root.file}:{one.line}: <transition>: target: there is no state "
                        f"{one.target!r}{did_you_mean(one.target, states)}"
                    )
