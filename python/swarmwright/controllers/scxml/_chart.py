"""Statecharts: nested states, their transitions and actions."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Assignment:
    """The assignment of a number to an actuator."""

    actuator: str
    value: float
    line: int


@dataclass(frozen=True)
class Event:
    """An event that the machine raises or sends to itself."""

    name: str
    internal: bool
    """Whether the event is raised, and so handled before events that are sent."""
    optional: bool
    """Whether the event may be for other receivers, so that no transition has to wait for it."""
    line: int


Action = Assignment | Event


@dataclass
class Transition:
    """A transition; without targets it neither leaves nor enters its state."""

    line: int
    events: list[str] = field(default_factory=list)
    """Descriptors of events; empty for a transition without an event."""
    condition: ast.expr | None = None
    targets: list[str] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)
    internal: bool = False
    """Whether the transition stays in its state if all targets are inside of it."""


@dataclass
class State:
    """A state, or a pseudostate."""

    name: str
    """Its `id`, or a description without one; empty for the whole machine."""
    line: int
    """Line in the file, from 1."""
    kind: str
    """`scxml` (the whole machine), `state`, `parallel`, `final` or `history`."""
    parent: "State | None"
    """The enclosing state; None for the whole machine."""
    order: int
    """Position in document order."""
    deep: bool = False
    """For a history: whether it remembers states at every depth."""
    children: list["State"] = field(default_factory=list)
    """Inner states and histories, in document order."""
    entry: list[Action] = field(default_factory=list)
    """Actions on entry."""
    exit: list[Action] = field(default_factory=list)
    """Actions on exit."""
    transitions: list[Transition] = field(default_factory=list)
    """Outgoing transitions, in document order."""
    initial: Transition | None = None
    """The initial transition; for a history, its default."""

    @property
    def inner(self) -> list["State"]:
        """The inner states, without histories."""
        return [child for child in self.children if child.kind != "history"]

    @property
    def is_atomic(self) -> bool:
        """Whether the state has no inner states."""
        return not self.inner

    @property
    def is_compound(self) -> bool:
        """Whether exactly one inner state is active."""
        return self.kind != "parallel" and not self.is_atomic

    @property
    def ancestors(self) -> list["State"]:
        """The enclosing states, innermost first."""
        ancestors = []
        state = self.parent
        while state is not None:
            ancestors.append(state)
            state = state.parent
        return ancestors

    def is_inside(self, other: "State") -> bool:
        """Whether the state is inside of another state, at any depth."""
        return any(ancestor is other for ancestor in self.ancestors)

    def walk(self) -> Iterator["State"]:
        """Yield the state and all inner states, in document order."""
        yield self
        for child in self.children:
            yield from child.walk()

    @property
    def all_transitions(self) -> list[Transition]:
        """Its transitions, including the initial transition."""
        return [*self.transitions, *([self.initial] if self.initial else [])]

    @property
    def actions(self) -> list[Action]:
        """All actions of the state and its transitions."""
        return [*self.entry, *self.exit, *(action for t in self.all_transitions for action in t.actions)]


def count_configurations(state: State) -> int:
    """Return the number of configurations of a state."""
    counts = [count_configurations(child) for child in state.inner]
    if not counts:
        return 1
    if state.kind != "parallel":
        return sum(counts)
    product = 1
    for count in counts:
        product *= count
    return product
