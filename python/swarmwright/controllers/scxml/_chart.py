"""Statecharts as files have them: states inside states, their transitions, and what these do."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Assignment:
    """A number for an actuator."""

    actuator: str
    value: float
    line: int


@dataclass(frozen=True)
class Event:
    """An event that the machine gives to itself."""

    name: str
    internal: bool
    """Raised, so that it comes before events that are sent."""
    optional: bool
    """Whether it may be meant for others, so that no transition has to wait for it."""
    line: int


Action = Assignment | Event


@dataclass
class Transition:
    """A transition; without targets it stays in its state, which it neither leaves nor enters."""

    line: int
    events: list[str] = field(default_factory=list)
    """Descriptors of events; none where it is taken without an event."""
    condition: ast.expr | None = None
    targets: list[str] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)
    internal: bool = False
    """Whether it does not leave its state where all targets are inside of it."""


@dataclass
class State:
    """A state, or a pseudostate."""

    name: str
    """Its `id`, or words for one without; empty for the whole machine."""
    line: int
    """Of the file, from 1."""
    kind: str
    """`scxml` (the whole machine), `state`, `parallel`, `final` or `history`."""
    parent: "State | None"
    """The state that it is in; None for the whole machine."""
    order: int
    """In the document."""
    deep: bool = False
    """Of a history: whether it remembers states at every depth."""
    children: list["State"] = field(default_factory=list)
    """States and histories inside, in the order of the document."""
    entry: list[Action] = field(default_factory=list)
    """What is executed when it is entered."""
    exit: list[Action] = field(default_factory=list)
    """What is executed when it is left."""
    transitions: list[Transition] = field(default_factory=list)
    """Those that leave it, in the order of the document."""
    initial: Transition | None = None
    """What is entered first; of a history, as long as there is nothing to remember."""

    @property
    def inner(self) -> list["State"]:
        """The states inside, without histories."""
        return [child for child in self.children if child.kind != "history"]

    @property
    def is_atomic(self) -> bool:
        """Whether there are no states inside."""
        return not self.inner

    @property
    def is_compound(self) -> bool:
        """Whether one of the states inside is active."""
        return self.kind != "parallel" and not self.is_atomic

    @property
    def ancestors(self) -> list["State"]:
        """The states around, the innermost first."""
        found = []
        state = self.parent
        while state is not None:
            found.append(state)
            state = state.parent
        return found

    def inside(self, other: "State") -> bool:
        """Whether it is inside of another state, at any depth."""
        return any(ancestor is other for ancestor in self.ancestors)

    def all(self) -> Iterator["State"]:
        """Yield it and all inside, in document order."""
        yield self
        for child in self.children:
            yield from child.all()

    @property
    def all_transitions(self) -> list[Transition]:
        """Its transitions, and the one that says what is entered first."""
        return [*self.transitions, *([self.initial] if self.initial else [])]

    @property
    def actions(self) -> list[Action]:
        """All that is done in it and by its transitions."""
        return [*self.entry, *self.exit, *(action for t in self.all_transitions for action in t.actions)]


def combinations(state: State) -> int:
    """Return in how many ways a state can be active, as the drawing has it."""
    counts = [combinations(child) for child in state.inner]
    if not counts:
        return 1
    if state.kind != "parallel":
        return sum(counts)
    product = 1
    for count in counts:
        product *= count
    return product
