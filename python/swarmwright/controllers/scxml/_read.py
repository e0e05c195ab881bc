"""Reader of SCXML files."""

import ast
import re
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes
from swarmwright.common.problems import ProblemLines
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.xml import Element
from swarmwright.common.xml import read as read_xml
from swarmwright.controllers.scxml._chart import Action, Assignment, Event, State, Transition
from swarmwright.controllers.scxml._conditions import ConditionError, evaluate_constant, parse_expression
from swarmwright.controllers.scxml._machine import EVENT, StateMachine, normalize_name
from swarmwright.controllers.scxml._steps import Descriptors

_BARE = re.compile(rb"<state\s*>")
_LARGEST_FILE_BYTES = 1 << 28
_IGNORED = frozenset({"log"})
_NAMESPACE = "http://www.w3.org/2005/07/scxml"
_EDITORS = frozenset({"http://www.qt.io/2015/02/scxml-ext"})
"""Namespaces of editors' annotations, which are ignored."""
_ACTING = frozenset({"onentry", "onexit", "transition"})
"""Elements in which elements of other namespaces may be actions."""
_DATA = '<data id="NAME" expr="0.5"/>'
_INSTEAD = {
    "invoke": 'controllers cannot call ROS actions; assign actuators: <assign location="heading" '
    'expr="0.5"/>',
    "if": "is not supported; use a transition with the condition",
    "script": "is not supported; assign actuators",
}

_STATES = ("final", "history", "parallel", "state")
_HOLD = {
    "final": ("scxml", "state"),
    "history": ("state", "parallel"),
    "parallel": ("scxml", "state", "parallel"),
    "state": ("scxml", "state", "parallel"),
}
"""Allowed parents of each kind of state."""
_EXPECTED = {
    "scxml": ("datamodel", "final", "parallel", "state"),
    "state": ("final", "history", "initial", "onentry", "onexit", "parallel", "state", "transition"),
    "parallel": ("history", "onentry", "onexit", "parallel", "state", "transition"),
    "final": ("onentry", "onexit"),
    "history": ("transition",),
}


def read(path: Path) -> StateMachine:
    """Read a state machine.

    Raises InputError with all problems and unsupported elements, each with file and line.
    """
    try:
        root = read_xml(path)
    except InputError as error:
        raise InputError(_find_unclosed_state(path) or str(error)) from error
    return _Reader(path, root).machine()


class _Namespaces:
    """Removes namespace prefixes, and elements of other namespaces than SCXML's."""

    def __init__(self, root: Element) -> None:
        # The namespace of the root element counts as SCXML's, so that files without the usual one can be
        # read.
        self.scxml_namespaces = {_NAMESPACE, self._namespace(root, {}), ""}
        self.problems = ProblemLines()
        self._strip_prefix(root, {}, "")

    @staticmethod
    def _namespaces(element: Element, outer: dict[str, str]) -> dict[str, str]:
        """Return the namespaces inside an element, by prefix; the default namespace has an empty prefix."""
        declared = {
            key.removeprefix("xmlns").removeprefix(":"): value
            for key, value in element.attributes.items()
            if key == "xmlns" or key.startswith("xmlns:")
        }
        return {**outer, **declared} if declared else outer

    def _namespace(self, element: Element, outer: dict[str, str]) -> str:
        """Return an element's namespace; empty without one or for an undeclared prefix."""
        prefix = element.tag.rpartition(":")[0]
        return self._namespaces(element, outer).get(prefix, "")

    def _strip_prefix(self, element: Element, outer: dict[str, str], parent_tag: str) -> bool:
        """Strip the prefix of an element; return whether to keep it. parent_tag: the tag of its parent."""
        namespace = self._namespace(element, outer)
        if namespace not in self.scxml_namespaces:
            if parent_tag in _ACTING and namespace not in _EDITORS:
                self.problems.add(
                    str(element.error(f"elements of {namespace} are not supported here; remove it"))
                )
            return False
        element.tag = element.tag.rpartition(":")[2]
        spaces = self._namespaces(element, outer)
        element.children = [
            child for child in element.children if self._strip_prefix(child, spaces, element.tag)
        ]
        return True


def _find_unclosed_state(path: Path) -> str | None:
    """Return the message for a file that closes states with `<state>`; None for other files."""
    data = read_bytes(path, _LARGEST_FILE_BYTES)
    match = _BARE.search(data)
    if match is None or data.count(b"</state") >= len(re.findall(rb"<state\s[^<>]*[^/<>]>", data)):
        return None
    line = data.count(b"\n", 0, match.start()) + 1
    return (
        f"{path}:{line}: <state> found where </state> is expected, a bug of some versions of Modelio's "
        "CPSwarm module; write </state> at the end of each state"
    )


class _Reader:
    def __init__(self, path: Path, root: Element) -> None:
        self.root = root
        self.problems = _Namespaces(root).problems
        self.states: dict[str, State] = {}
        self._declared_names: dict[str, str] = {}
        """Normalized name of data -> declared name."""
        self._constants: dict[str, float] = {}
        """Numbers of data by normalized name."""
        top = State("", root.line, "scxml", None, 0)
        self.state_machine = StateMachine(path, root.attributes.get("name", ""), top)

    def problem(self, element: Element, message: str) -> None:
        self.problems.add(str(element.error(message)))

    def machine(self) -> StateMachine:
        self._read_content(self.state_machine.root, self.root)
        self._check_targets()
        self._check_events()
        self.problems.stop()
        return self.state_machine

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
            elif name in self.state_machine.declared:
                self.problem(element, f"duplicate id {name!r}; keep one")
            elif (normalized := normalize_name(name)) in self._declared_names:
                other = self._declared_names[normalized]
                self.problem(
                    element, f"the ids {other!r} and {name!r} are equal in expressions; rename one of them"
                )
            else:
                self._declared_names[normalized] = name
                value = self.state_machine.declared[name] = self._data_value(element)
                if value is not None:
                    self._constants[normalized] = value

    def _data_value(self, element: Element) -> float | None:
        """Return the number of a `<data>`, from its attribute or content; None without one."""
        text = element.text.strip()
        if "src" in element.attributes:
            self.problem(element, f"src: is not supported; write the number, {_DATA}")
        elif element.children:
            self.problem(element, f"<{element.children[0].tag}> found inside; expected a number, {_DATA}")
        elif "expr" in element.attributes and text:
            self.problem(element, f"has both the attribute expr and {text[:40]!r} inside; keep one")
        elif "expr" in element.attributes:
            return self._number(element, "expr")
        elif text:
            return self._value(element, text, "content")
        return None

    def _number(self, element: Element, attribute: str) -> float:
        text = element.attributes.get(attribute)
        if text is None:
            self.problem(element, f"the attribute {attribute} is missing")
            return 0.0
        return self._value(element, text, attribute)

    def _value(self, element: Element, text: str, label: str) -> float:
        try:
            return evaluate_constant(parse_expression(text), self._constants)
        except ConditionError as error:
            self.problem(element, f"{label}: {error}")
            return 0.0

    def _read_content(self, parent: State, element: Element) -> None:
        """Read the content of a state, or of the machine."""
        for inner in element.children:
            if inner.tag in _STATES:
                if parent.kind not in _HOLD[inner.tag]:
                    self.problem(inner, f"cannot be inside of <{element.tag}>")
                    continue
                self._state(parent, inner)
            elif inner.tag == "datamodel" and parent.kind == "scxml":
                self._data(inner)
            elif inner.tag == "datamodel":
                pass  # belongs to an <invoke>, which is reported
            elif inner.tag == "initial" and parent.kind == "state":
                self._initial(parent, inner)
            elif inner.tag in {"onentry", "onexit"} and parent.kind not in {"scxml", "history"}:
                (parent.entry if inner.tag == "onentry" else parent.exit).extend(self._actions(inner))
            elif inner.tag == "transition" and parent.kind == "history":
                self._initial(parent, element)
            elif inner.tag == "transition" and parent.kind in {"state", "parallel"}:
                parent.transitions.append(self._transition(inner))
            else:
                self._unknown(inner, _EXPECTED[parent.kind])
        initial_targets = element.attributes.get("initial", "").split()
        if initial_targets and parent.kind in {"scxml", "state"}:
            if parent.initial is not None:
                self.problem(element, "has both an attribute initial and <initial>; keep one")
            parent.initial = Transition(element.line, targets=initial_targets)

    def _state(self, parent: State, element: Element) -> None:
        name = element.attributes.get("id", "").strip()
        if not name and element.tag == "history":
            name = f"history in line {element.line}"
        if not name:
            self.problem(element, "the attribute id is missing")
            return
        if name in self.states:
            first = self.states[name].line
            self.problem(element, f"duplicate id {name!r} (first in line {first}); keep one")
            return
        depth = element.attributes.get("type", "shallow")
        if element.tag == "history" and depth not in {"shallow", "deep"}:
            self.problem(element, f"type {depth!r} found, expected shallow or deep")
        # States are read in document order.
        state = State(name, element.line, element.tag, parent, len(self.states) + 1, depth == "deep")
        self.states[name] = state
        parent.children.append(state)
        self._read_content(state, element)
        if state.kind == "history" and state.initial is None:
            self.problem(element, 'has no default; add <transition target=".."/>')
        if state.kind == "parallel" and state.is_atomic:
            self.problem(element, "has no states inside; expected two or more")

    def _initial(self, parent: State, element: Element) -> None:
        """Read the initial transition: the only transition of an `<initial>` or a history."""
        transitions = element.find_all("transition")
        if len(transitions) != 1:
            self.problem(element, f"{len(transitions)} transitions found inside; expected one")
        if parent.initial is not None or not transitions:
            return
        parent.initial = self._transition(transitions[0])
        if parent.initial.events or parent.initial.condition or not parent.initial.targets:
            self.problem(transitions[0], "expected a target, without event and cond")

    def _transition(self, element: Element) -> Transition:
        text = element.attributes.get("cond")
        tree: ast.expr | None = None
        if text is not None:
            try:
                tree = parse_expression(text)
            except ConditionError as error:
                self.problem(element, f"cond: {error}")
        kind = element.attributes.get("type", "external")
        if kind not in {"external", "internal"}:
            self.problem(element, f"type {kind!r} found, expected external or internal")
        return Transition(
            element.line,
            element.attributes.get("event", "").split(),
            tree,
            element.attributes.get("target", "").split(),
            self._actions(element),
            kind == "internal",
        )

    def _actions(self, element: Element) -> list[Action]:
        actions: list[Action] = []
        for inner in element.children:
            if inner.tag == "assign":
                location = inner.attributes.get("location", "").strip()
                if not location:
                    self.problem(inner, "the attribute location is missing; it names an actuator")
                actions.append(Assignment(location, self._output(inner), inner.line))
            elif inner.tag == "raise":
                self._event(inner, actions, internal=True)
            elif inner.tag == "send":
                self._send(inner, actions)
            else:
                self._unknown(inner, ("assign", "log", "raise", "send"))
        return actions

    def _send(self, element: Element, actions: list[Action]) -> None:
        for parameter in element.children:
            name = parameter.attributes.get("name", "").strip()
            if parameter.tag != "param" or not name:
                self.problem(parameter, 'expected <param name="ACTUATOR" expr="NUMBER"/> inside <send>')
                continue
            actions.append(Assignment(name, self._output(parameter), parameter.line))
        for attribute in ("delay", "delayexpr"):
            if attribute in element.attributes:
                self.problem(element, f"{attribute}: is not supported; count control steps with states")
        target = element.attributes.get("target", "")
        if target not in {"", "#_internal"}:
            if not element.children:
                self.problem(
                    element,
                    f"target {target!r} is not supported: controllers send events to themselves only; remove "
                    "it, "
                    'or write target="#_internal"',
                )
        elif element.children or "event" in element.attributes:
            self._event(element, actions, internal=bool(target))
        else:
            self.problem(
                element, 'is empty; expected an event, or <param name="ACTUATOR" expr="NUMBER"/> inside'
            )

    def _event(self, element: Element, actions: list[Action], *, internal: bool) -> None:
        name = element.attributes.get("event", "").strip()
        if not name and not element.children:
            self.problem(element, "the attribute event is missing")
        elif name == EVENT:
            self.problem(element, f"the event {EVENT!r} is reserved for control steps; choose another name")
        elif name:
            actions.append(Event(name, internal, bool(element.children), element.line))

    def _output(self, element: Element) -> float:
        value = self._number(element, "expr")
        if abs(value) > 1:
            self.problem(element, f"expr: {value:g} found, expected -1 to 1, the range of an actuator")
        return value

    def _check_events(self) -> None:
        """Drop events that no transition waits for; report those without actuators, which are mistakes."""
        descriptors = [
            event for state in self.states.values() for t in state.transitions for event in t.events
        ]
        awaited = Descriptors(descriptors)
        for state in self.states.values():
            for block in (state.entry, state.exit, *(t.actions for t in state.all_transitions)):
                for sent in [item for item in block if isinstance(item, Event)]:
                    if awaited.match(sent.name):
                        continue
                    block.remove(sent)
                    if not sent.optional:
                        self.problems.add(
                            f"{self.root.file}:{sent.line}: event: no transition waits for {sent.name!r}"
                            f"{did_you_mean(sent.name, descriptors)}"
                        )

    def _check_targets(self) -> None:
        if not self.states:
            self.problem(self.root, "has no states")
            return
        for state in (self.state_machine.root, *self.states.values()):
            if state.initial is not None:
                self._check(state, state.initial, "initial" if state.kind != "history" else "target")
            elif state.is_compound:
                state.initial = Transition(state.line, targets=[state.inner[0].name])
            for transition in state.transitions:
                self._check(state, transition, "target")

    def _check(self, state: State, transition: Transition, attribute: str) -> None:
        """Check that targets exist, are inside the required state, and can be active together."""
        element = "transition" if attribute == "target" else state.kind
        location = f"{self.root.file}:{transition.line}: <{element}>: {attribute}:"
        targets = []
        for name in transition.targets:
            if name in self.states:
                targets.append(self.states[name])
            else:
                self.problems.add(f"{location} unknown state {name!r}{did_you_mean(name, self.states)}")
        if transition is state.initial:
            parent = state.parent if state.kind == "history" else state
            for target in targets:
                shallow = state.kind == "history" and not state.deep
                if (
                    parent is None
                    or not target.is_inside(parent)
                    or (shallow and target.parent is not parent)
                ):
                    relation = "directly inside" if shallow else "inside"
                    self.problems.add(
                        f"{location} {target.name!r} is not {relation} {parent.name if parent else ''!r}"
                    )
        within: dict[int, State] = {}  # state -> a target that is the state or inside of it
        for target in targets:
            around = [target, *target.ancestors]
            meeting = next((up for up in around if id(up) in within), None)
            if meeting is not None:
                other = within[id(meeting)]
                if meeting.kind != "parallel" or meeting is target or meeting is other:
                    self.problems.add(
                        f"{location} {other.name!r} and {target.name!r} cannot be entered together; they "
                        "must be in different regions of a <parallel>"
                    )
            for up in around:
                within.setdefault(id(up), target)
