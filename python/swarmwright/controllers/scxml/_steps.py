"""Steps of statecharts, by the algorithm of SCXML's appendix D, for many values of the sensors at once.

Document order decides between the regions of a parallel state, and inner states come before outer ones. What
is chosen depends on the sensors through conditions alone; each branch below has the rows, combinations of
intervals of the sensors, for which the same transitions are taken.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.scxml._chart import Event, State, Transition
from swarmwright.controllers.scxml._conditions import Bits, Condition, named

Rows = NDArray[np.int64]
Output = tuple[int, float]
"""An actuator, and the number that it gets."""
_MOST_EVENTS = 10_000
"""Events that wait at once, at most."""
_MOST_ASSIGNMENTS = 100_000
"""Assignments of one step, at most."""
_MOST_MICROSTEPS = 1000
"""Transitions of one step after which a machine is said not to come to rest."""


@dataclass(frozen=True)
class Snapshot:
    """What a machine keeps from one control step to the next, besides numbers of actuators."""

    active: tuple[int, ...]
    """States, by their order in the document."""
    remembered: tuple[tuple[int, tuple[int, ...]], ...] = ()
    """Of histories that have something to remember."""


@dataclass(eq=False)
class Edge:
    """A transition with what it means for this simulation's sensors and actuators."""

    source: State
    of: Transition
    targets: list[State]
    condition: Condition = True
    on_step: Condition | None = None
    """When the event of a control step triggers it; None for never."""
    compares: bool = False
    """Whether it depends on a sensor, or on a control step."""


@dataclass(frozen=True)
class _Branch:
    """Rows for which a step has gone the same way so far. States are named by their `order`."""

    rows: Rows
    """Indices of the rows."""
    active: frozenset[int]
    """States that are active."""
    remembered: dict[int, tuple[int, ...]]
    """States that each history remembers."""
    internal: tuple[str, ...] = ()
    """Internal events that wait, the first one first."""
    external: tuple[str, ...] = ()
    """External events that wait: those that the machine has sent to itself."""
    done: tuple[Output, ...] = ()
    """Assignments that were executed, in order."""
    seen: frozenset[Any] = frozenset()
    """Configurations between microsteps: one that comes again never ends."""
    microsteps: int = 0
    """How many sets of transitions were taken."""

    @property
    def snapshot(self) -> Snapshot:
        return Snapshot(tuple(sorted(self.active)), tuple(sorted(self.remembered.items())))


class EndlessError(ValueError):
    """Transitions without an event of a control step go in a circle. The message names a state."""


class Steps:
    """Steps of a statechart.

    Args:
        root: the machine.
        edges: all transitions, by `id` of the `Transition`.
        outputs: for each action that assigns, by its `id`, what it does.
        truth: returns, for a condition and the names of active states, whether it holds for each row.
        rows: number of rows.
    """

    def __init__(
        self,
        root: State,
        edges: dict[int, Edge],
        outputs: dict[int, Output],
        truth: Callable[[Condition, frozenset[str]], Bits],
        rows: int,
    ) -> None:
        self._states = list(root.all())
        self._root, self._edges, self._outputs, self._truth, self._count = root, edges, outputs, truth, rows
        self._known: dict[tuple[int, bool, frozenset[str]], Bits] = {}

    def begin(self) -> tuple[Snapshot, tuple[Output, ...]]:
        """Enter the machine. Sensors have no values yet: transitions that depend on them are not taken."""
        nothing = _Branch(np.zeros(1, np.int64), frozenset(), {})
        initial = self._root.initial
        assert initial is not None  # the reader gives every compound state one
        [end] = self._finish([self._enter(nothing, [self._edges[id(initial)]])], started=False)
        return end.snapshot, end.done

    def step(self, snapshot: Snapshot) -> list[tuple[Rows, Snapshot, tuple[Output, ...]]]:
        """Return, for parts of all rows, the state after a control step, and numbers in their order."""
        begin = _Branch(np.arange(self._count), frozenset(snapshot.active), dict(snapshot.remembered))
        taken = self._triggered(begin, lambda edge: edge.on_step)
        return [(end.rows, end.snapshot, end.done) for end in self._finish(taken, started=True)]

    def _finish(self, waiting: list[_Branch], *, started: bool) -> list[_Branch]:
        """Take transitions without an event, then those of events that the machine gave to itself."""
        ends = []
        while waiting:
            branch = waiting.pop()
            key = (branch.active, branch.snapshot.remembered, branch.internal, branch.external)
            if key in branch.seen or branch.microsteps > _MOST_MICROSTEPS:
                atomic = min(state for state in branch.active if self._states[state].is_atomic)
                raise EndlessError(repr(self._states[atomic].name))
            _check_size(branch)
            branch = replace(branch, seen=branch.seen | {key})
            for rows, chosen in self._select(branch, lambda e: None if e.of.events else e.condition, started):
                part = replace(branch, rows=rows)
                if chosen:
                    waiting.append(self._microstep(part, chosen))
                elif branch.internal:
                    event, rest = branch.internal[0], branch.internal[1:]
                    waiting += self._on(replace(part, internal=rest), event, started)
                elif branch.external:
                    event, rest = branch.external[0], branch.external[1:]
                    waiting += self._on(replace(part, external=rest), event, started)
                else:
                    ends.append(part)
        return ends

    def _on(self, branch: _Branch, event: str, started: bool) -> list[_Branch]:
        def condition(edge: Edge) -> Condition | None:
            return edge.condition if any(matches(awaited, event) for awaited in edge.of.events) else None

        return self._triggered(branch, condition, started)

    def _triggered(
        self, branch: _Branch, condition: Callable[[Edge], Condition | None], started: bool = True
    ) -> list[_Branch]:
        found = []
        for rows, chosen in self._select(branch, condition, started):
            part = replace(branch, rows=rows)
            found.append(self._microstep(part, chosen) if chosen else part)
        return found

    def _select(
        self, branch: _Branch, condition: Callable[[Edge], Condition | None], started: bool
    ) -> list[tuple[Rows, list[Edge]]]:
        """Return the transitions taken: for each atomic state the first, inner states before outer ones."""
        if any(self._states[place].kind == "final" and self._is_top(place) for place in branch.active):
            return [(branch.rows, [])]
        found: list[tuple[Rows, list[Edge]]] = [(branch.rows, [])]
        for number in sorted(branch.active):
            state = self._states[number]
            if not state.is_atomic:
                continue
            around = [
                self._edges[id(transition)]
                for at in (state, *state.ancestors)
                for transition in at.transitions
            ]
            tried = [(edge, test) for edge in around if (test := condition(edge)) is not None]
            after = []
            for rows, chosen in found:
                left = rows
                for edge, test in tried:
                    if not left.size:
                        break
                    if started:
                        holds = self._holds(edge, test, branch.active)[left]
                    else:
                        holds = self._early(edge, test, branch)
                    if holds.any():
                        after.append((left[holds], chosen if edge in chosen else [*chosen, edge]))
                        left = left[~holds]
                if left.size:
                    after.append((left, chosen))
            found = after
        return [(rows, self._without_conflicts(branch, chosen)) for rows, chosen in found]

    def _is_top(self, number: int) -> bool:
        return self._states[number].parent is self._root

    def _early(self, edge: Edge, test: Condition, branch: _Branch) -> Bits:
        if edge.compares:
            return np.zeros(1, np.bool_)
        return self._truth(test, self._names(branch.active))[:1]

    def _names(self, active: frozenset[int]) -> frozenset[str]:
        return frozenset(self._states[state].name for state in active)

    def _holds(self, edge: Edge, test: Condition, active: frozenset[int]) -> Bits:
        asked = named(test)
        names = self._names(active) & asked if asked else frozenset[str]()
        key = (id(edge), test is edge.on_step, names)
        if key not in self._known:
            self._known[key] = self._truth(test, names)
        return self._known[key]

    def _without_conflicts(self, branch: _Branch, chosen: list[Edge]) -> list[Edge]:
        """Leave out transitions that would leave a state which another one leaves: inner sources win."""
        kept: list[tuple[Edge, frozenset[int]]] = []
        for state in chosen:
            leaves = self._exits(branch, [state])
            rivals = [other for other in kept if leaves & other[1]]
            if all(state.source.inside(other.source) for other, _ in rivals):
                kept = [other for other in kept if other not in rivals] + [(state, leaves)]
        return [edge for edge, _ in kept]

    def _microstep(self, branch: _Branch, chosen: list[Edge]) -> _Branch:
        leaves = self._exits(branch, chosen)
        remembered = dict(branch.remembered)
        for number in leaves:
            for history in self._states[number].children:
                if history.kind == "history":
                    remembered[history.order] = self._memory(history, branch.active)
        done, internal, external = branch.done, branch.internal, branch.external
        blocks = [self._states[number].exit for number in sorted(leaves, reverse=True)]
        blocks += [edge.of.actions for edge in chosen]
        for block in blocks:
            done += self._outputs_of(block)
            internal, external = _queued(block, internal, external)
        left = replace(
            branch,
            active=branch.active - leaves,
            remembered=remembered,
            internal=internal,
            external=external,
            done=done,
            microsteps=branch.microsteps + 1,
        )
        # A history that is a target is looked up as it is after states were left.
        return self._enter(left, chosen)

    def _memory(self, history: State, active: frozenset[int]) -> tuple[int, ...]:
        parent = history.parent
        assert parent is not None
        inside = [state for state in sorted(active) if self._states[state].inside(parent)]
        if history.deep:
            return tuple(state for state in inside if self._states[state].is_atomic)
        return tuple(state for state in inside if self._states[state].parent is parent)

    def _outputs_of(self, block: Sequence[Any]) -> tuple[Output, ...]:
        return tuple(self._outputs[id(item)] for item in block if id(item) in self._outputs)

    def _targets(self, branch: _Branch, targets: Sequence[State]) -> list[State]:
        """Return targets with what histories stand for."""
        found = []
        for target in targets:
            if target.kind != "history":
                found.append(target)
            elif target.order in branch.remembered:
                found += [self._states[state] for state in branch.remembered[target.order]]
            else:
                assert target.initial is not None
                found += self._targets(branch, self._edges[id(target.initial)].targets)
        return found

    def _domain(self, branch: _Branch, edge: Edge) -> State:
        """Return the state in which everything is left."""
        targets = self._targets(branch, edge.targets)
        source = edge.source
        if edge.of.internal and source.is_compound and all(target.inside(source) for target in targets):
            return source
        for around in source.ancestors:
            if (around.is_compound or around is self._root) and all(
                target.inside(around) for target in targets
            ):
                return around
        return self._root

    def _exits(self, branch: _Branch, edges: Sequence[Edge]) -> frozenset[int]:
        exits: set[int] = set()
        for edge in edges:
            if edge.targets:
                domain = self._domain(branch, edge)
                exits |= {state for state in branch.active if self._states[state].inside(domain)}
        return frozenset(exits)

    def _enter(self, branch: _Branch, chosen: Sequence[Edge]) -> _Branch:
        entry = _Entry(self, branch)
        for edge in chosen:
            for target in edge.targets:
                entry.down(target)
            if not edge.targets:
                continue
            domain = self._root if edge.source is self._root else self._domain(branch, edge)
            for target in self._targets(branch, edge.targets):
                entry.up(target, domain)
        active, done = set(branch.active), branch.done
        internal, external = branch.internal, branch.external
        for number in sorted(entry.states):
            state = self._states[number]
            active.add(number)
            blocks = [state.entry]
            if number in entry.default and state.initial is not None:
                blocks.append(state.initial.actions)
            blocks += entry.histories.get(number, [])
            for block in blocks:
                done += self._outputs_of(block)
                internal, external = _queued(block, internal, external)
            if state.kind == "final" and state.parent is not None and state.parent is not self._root:
                internal += (f"done.state.{state.parent.name}",)
                outer = state.parent.parent
                if outer is not None and outer.kind == "parallel" and self._is_done(outer, active):
                    internal += (f"done.state.{outer.name}",)
        return replace(branch, active=frozenset(active), done=done, internal=internal, external=external)

    def _is_done(self, state: State, active: set[int]) -> bool:
        if state.kind == "parallel":
            return all(self._is_done(inner, active) for inner in state.inner)
        return any(inner.kind == "final" and inner.order in active for inner in state.inner)


class _Entry:
    """The states that are entered."""

    def __init__(self, steps: Steps, branch: _Branch) -> None:
        self._steps, self._branch = steps, branch
        self.states: set[int] = set()
        self.default: set[int] = set()
        self.histories: dict[int, list[Any]] = {}
        """Of states whose history has nothing to remember: what is done then."""

    def down(self, state: State) -> None:
        """Enter a state and what is entered inside of it."""
        if state.kind == "history":
            self._history(state)
            return
        self.states.add(state.order)
        if state.kind == "parallel":
            self._regions(state)
        elif state.is_compound:
            assert state.initial is not None
            self.default.add(state.order)
            self._all(self._steps._edges[id(state.initial)].targets, state)

    def _history(self, state: State) -> None:
        parent, initial = state.parent, state.initial
        assert parent is not None
        assert initial is not None
        remembered = self._branch.remembered.get(state.order)
        if remembered is not None:
            self._all([self._steps._states[order] for order in remembered], parent)
            return
        self.histories.setdefault(parent.order, []).append(initial.actions)
        self._all(self._steps._edges[id(initial)].targets, parent)

    def _all(self, targets: Sequence[State], within: State) -> None:
        for target in targets:
            self.down(target)
        for target in targets:
            self.up(target, within)

    def up(self, state: State, domain: State) -> None:
        """Enter the states around one, up to a domain, and the other regions of parallel ones."""
        for around in state.ancestors:
            if around is domain:
                break
            self.states.add(around.order)
            if around.kind == "parallel":
                self._regions(around)

    def _regions(self, state: State) -> None:
        for region in state.inner:
            if not any(
                order == region.order or self._steps._states[order].inside(region) for order in self.states
            ):
                self.down(region)


def _queued(
    block: Sequence[Any], internal: tuple[str, ...], external: tuple[str, ...]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return both queues with the events of a block of actions."""
    events = [item for item in block if isinstance(item, Event)]
    return (
        internal + tuple(event.name for event in events if event.internal),
        external + tuple(event.name for event in events if not event.internal),
    )


def _check_size(branch: _Branch) -> None:
    """Raise ValueError for a machine that goes on and on, before it takes all memory."""
    if len(branch.internal) + len(branch.external) > _MOST_EVENTS:
        raise ValueError(f"more than {_MOST_EVENTS} events wait at once")
    if len(branch.done) > _MOST_ASSIGNMENTS:
        raise ValueError(f"one step assigns more than {_MOST_ASSIGNMENTS} numbers")


class Descriptors:
    """Descriptors of events, of which one may match an event as in `matches`."""

    def __init__(self, descriptors: Collection[str]) -> None:
        self._all = "*" in descriptors
        self._prefixes = {_prefix(descriptor) for descriptor in descriptors}
        self._lengths = sorted({len(prefix) for prefix in self._prefixes})

    def match(self, event: str) -> bool:
        """Whether one of them names an event."""
        return self._all or any(
            event[:length] in self._prefixes and event[length : length + 1] in {"", "."}
            for length in self._lengths
            if length <= len(event)
        )


def matches(descriptor: str, event: str) -> bool:
    """Whether a descriptor names an event: `*` names all, `a` also `a.b`."""
    if descriptor == "*":
        return True
    prefix = _prefix(descriptor)
    return event == prefix or event.startswith(f"{prefix}.")


def _prefix(descriptor: str) -> str:
    return descriptor.removesuffix("*").removesuffix(".")
