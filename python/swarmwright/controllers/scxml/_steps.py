"""Steps of statecharts, by the algorithm of SCXML's appendix D, for many values of the sensors at once.

Regions of a parallel state are handled in document order, inner states before outer states. Transitions
depend on the sensors through conditions only; each branch below holds the rows, combinations of sensor
intervals, for which the same transitions are taken.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.scxml._chart import Event, State, Transition
from swarmwright.controllers.scxml._conditions import Bits, Condition, state_names

Rows = NDArray[np.int64]
Output = tuple[int, float]
"""An actuator and its number."""
_MOST_EVENTS = 10_000
"""Largest number of events in the queues."""
_MOST_ASSIGNMENTS = 100_000
"""Largest number of assignments of one step."""
_MOST_MICROSTEPS = 1000
"""Largest number of sets of transitions of one step; beyond, the step counts as endless."""


@dataclass(frozen=True)
class Snapshot:
    """State of a machine between control steps, apart from the numbers of actuators."""

    active: tuple[int, ...]
    """Active states, by document order."""
    remembered: tuple[tuple[int, tuple[int, ...]], ...] = ()
    """States remembered by histories."""


@dataclass(eq=False)
class Edge:
    """A transition, resolved for the sensors and actuators of the simulation."""

    source: State
    transition: Transition
    targets: list[State]
    condition: Condition = True
    on_step: Condition | None = None
    """Condition under which a control step triggers it; None for never."""
    compares: bool = False
    """Whether the transition depends on a sensor, or on a control step."""


@dataclass(frozen=True)
class _Branch:
    """Rows for which a step has taken the same transitions so far. States are numbers, their `order`."""

    rows: Rows
    """Indices of the rows."""
    active: frozenset[int]
    """States that are active."""
    remembered: dict[int, tuple[int, ...]]
    """States that each history remembers."""
    internal: tuple[str, ...] = ()
    """Queue of internal events, first in first out."""
    external: tuple[str, ...] = ()
    """Queue of external events: those that the machine has sent to itself."""
    done: tuple[Output, ...] = ()
    """Assignments that were executed, in order."""
    configurations: frozenset[Any] = frozenset()
    """Configurations between microsteps; a repeated configuration is an endless loop."""
    microsteps: int = 0
    """Number of sets of transitions taken."""

    @property
    def snapshot(self) -> Snapshot:
        return Snapshot(tuple(sorted(self.active)), tuple(sorted(self.remembered.items())))


class EndlessError(ValueError):
    """Transitions without an event form an endless loop. The message names a state."""


class Steps:
    """Steps of a statechart.

    Args:
        root: the machine.
        edges: all transitions, by `id` of the `Transition`.
        outputs: actuator and number of each assignment, by its `id`.
        truth: evaluates a condition for each row, with the names of active states.
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
        self._states = list(root.walk())
        self._root, self._edges, self._outputs, self._truth, self._count = root, edges, outputs, truth, rows
        self._truth_cache: dict[tuple[int, bool, frozenset[str]], Bits] = {}

    def begin(self) -> tuple[Snapshot, tuple[Output, ...]]:
        """Enter the machine. Sensors have no values yet: transitions that depend on them are not taken."""
        nothing = _Branch(np.zeros(1, np.int64), frozenset(), {})
        initial = self._root.initial
        assert initial is not None  # the reader gives every compound state one
        [end] = self._finish([self._enter(nothing, [self._edges[id(initial)]])], started=False)
        return end.snapshot, end.done

    def step(self, snapshot: Snapshot) -> list[tuple[Rows, Snapshot, tuple[Output, ...]]]:
        """Return, for each subset of rows, the state after a control step and its outputs in order."""
        begin = _Branch(np.arange(self._count), frozenset(snapshot.active), dict(snapshot.remembered))
        branches = self._take_transitions(begin, lambda edge: edge.on_step)
        return [(end.rows, end.snapshot, end.done) for end in self._finish(branches, started=True)]

    def _finish(self, waiting: list[_Branch], *, started: bool) -> list[_Branch]:
        """Take transitions without an event, then those of queued events, until the step ends."""
        ends = []
        while waiting:
            branch = waiting.pop()
            key = (branch.active, branch.snapshot.remembered, branch.internal, branch.external)
            if key in branch.configurations or branch.microsteps > _MOST_MICROSTEPS:
                atomic = min(state for state in branch.active if self._states[state].is_atomic)
                raise EndlessError(repr(self._states[atomic].name))
            _check_size(branch)
            branch = replace(branch, configurations=branch.configurations | {key})
            for rows, chosen in self._select(
                branch, lambda edge: None if edge.transition.events else edge.condition, started
            ):
                part = replace(branch, rows=rows)
                if chosen:
                    waiting.append(self._microstep(part, chosen))
                elif branch.internal:
                    event, rest = branch.internal[0], branch.internal[1:]
                    waiting += self._handle_event(replace(part, internal=rest), event, started)
                elif branch.external:
                    event, rest = branch.external[0], branch.external[1:]
                    waiting += self._handle_event(replace(part, external=rest), event, started)
                else:
                    ends.append(part)
        return ends

    def _handle_event(self, branch: _Branch, event: str, started: bool) -> list[_Branch]:
        def condition(edge: Edge) -> Condition | None:
            return (
                edge.condition if any(matches(awaited, event) for awaited in edge.transition.events) else None
            )

        return self._take_transitions(branch, condition, started)

    def _take_transitions(
        self, branch: _Branch, condition: Callable[[Edge], Condition | None], started: bool = True
    ) -> list[_Branch]:
        branches = []
        for rows, chosen in self._select(branch, condition, started):
            part = replace(branch, rows=rows)
            branches.append(self._microstep(part, chosen) if chosen else part)
        return branches

    def _select(
        self, branch: _Branch, condition: Callable[[Edge], Condition | None], started: bool
    ) -> list[tuple[Rows, list[Edge]]]:
        """Select the first transition that holds of each atomic state, inner states before outer states."""
        if any(self._states[order].kind == "final" and self._is_top(order) for order in branch.active):
            return [(branch.rows, [])]
        selections: list[tuple[Rows, list[Edge]]] = [(branch.rows, [])]
        for number in sorted(branch.active):
            state = self._states[number]
            if not state.is_atomic:
                continue
            edges = [
                self._edges[id(transition)]
                for holder in (state, *state.ancestors)
                for transition in holder.transitions
            ]
            candidates = [(edge, test) for edge in edges if (test := condition(edge)) is not None]
            after = []
            for rows, chosen in selections:
                remaining = rows
                for edge, test in candidates:
                    if not remaining.size:
                        break
                    if started:
                        holds = self._holds(edge, test, branch.active)[remaining]
                    else:
                        holds = self._early(edge, test, branch)
                    if holds.any():
                        after.append((remaining[holds], chosen if edge in chosen else [*chosen, edge]))
                        remaining = remaining[~holds]
                if remaining.size:
                    after.append((remaining, chosen))
            selections = after
        return [(rows, self._resolve_conflicts(branch, chosen)) for rows, chosen in selections]

    def _is_top(self, number: int) -> bool:
        return self._states[number].parent is self._root

    def _early(self, edge: Edge, test: Condition, branch: _Branch) -> Bits:
        if edge.compares:
            return np.zeros(1, np.bool_)
        return self._truth(test, self._names(branch.active))[:1]

    def _names(self, active: frozenset[int]) -> frozenset[str]:
        return frozenset(self._states[state].name for state in active)

    def _holds(self, edge: Edge, test: Condition, active: frozenset[int]) -> Bits:
        tested_names = state_names(test)
        names = self._names(active) & tested_names if tested_names else frozenset[str]()
        key = (id(edge), test is edge.on_step, names)
        if key not in self._truth_cache:
            self._truth_cache[key] = self._truth(test, names)
        return self._truth_cache[key]

    def _resolve_conflicts(self, branch: _Branch, chosen: list[Edge]) -> list[Edge]:
        """Drop transitions that exit a state which another transition exits: inner sources win."""
        winners: list[tuple[Edge, frozenset[int]]] = []
        for edge in chosen:
            exits = self._exits(branch, [edge])
            rivals = [winner for winner in winners if exits & winner[1]]
            if all(edge.source.is_inside(rival.source) for rival, _ in rivals):
                winners = [winner for winner in winners if winner not in rivals] + [(edge, exits)]
        return [edge for edge, _ in winners]

    def _microstep(self, branch: _Branch, chosen: list[Edge]) -> _Branch:
        leaves = self._exits(branch, chosen)
        remembered = dict(branch.remembered)
        for number in leaves:
            for history in self._states[number].children:
                if history.kind == "history":
                    remembered[history.order] = self._memory(history, branch.active)
        done, internal, external = branch.done, branch.internal, branch.external
        blocks = [self._states[number].exit for number in sorted(leaves, reverse=True)]
        blocks += [edge.transition.actions for edge in chosen]
        for block in blocks:
            done += self._outputs_of(block)
            internal, external = _queue_events(block, internal, external)
        exited = replace(
            branch,
            active=branch.active - leaves,
            remembered=remembered,
            internal=internal,
            external=external,
            done=done,
            microsteps=branch.microsteps + 1,
        )
        # Histories that are targets are looked up after states are exited.
        return self._enter(exited, chosen)

    def _memory(self, history: State, active: frozenset[int]) -> tuple[int, ...]:
        parent = history.parent
        assert parent is not None
        inside = [state for state in sorted(active) if self._states[state].is_inside(parent)]
        if history.deep:
            return tuple(state for state in inside if self._states[state].is_atomic)
        return tuple(state for state in inside if self._states[state].parent is parent)

    def _outputs_of(self, block: Sequence[Any]) -> tuple[Output, ...]:
        return tuple(self._outputs[id(item)] for item in block if id(item) in self._outputs)

    def _targets(self, branch: _Branch, targets: Sequence[State]) -> list[State]:
        """Return targets, with histories replaced by the states that they stand for."""
        resolved = []
        for target in targets:
            if target.kind != "history":
                resolved.append(target)
            elif target.order in branch.remembered:
                resolved += [self._states[state] for state in branch.remembered[target.order]]
            else:
                assert target.initial is not None
                resolved += self._targets(branch, self._edges[id(target.initial)].targets)
        return resolved

    def _domain(self, branch: _Branch, edge: Edge) -> State:
        """Return the domain of a transition: the state whose inner states are all exited."""
        targets = self._targets(branch, edge.targets)
        source = edge.source
        if (
            edge.transition.internal
            and source.is_compound
            and all(target.is_inside(source) for target in targets)
        ):
            return source
        for around in source.ancestors:
            if (around.is_compound or around is self._root) and all(
                target.is_inside(around) for target in targets
            ):
                return around
        return self._root

    def _exits(self, branch: _Branch, edges: Sequence[Edge]) -> frozenset[int]:
        exits: set[int] = set()
        for edge in edges:
            if edge.targets:
                domain = self._domain(branch, edge)
                exits |= {state for state in branch.active if self._states[state].is_inside(domain)}
        return frozenset(exits)

    def _enter(self, branch: _Branch, chosen: Sequence[Edge]) -> _Branch:
        entry = _Entry(self, branch)
        for edge in chosen:
            for target in edge.targets:
                entry.enter_inside(target)
            if not edge.targets:
                continue
            domain = self._root if edge.source is self._root else self._domain(branch, edge)
            for target in self._targets(branch, edge.targets):
                entry.enter_ancestors(target, domain)
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
                internal, external = _queue_events(block, internal, external)
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
    """The set of states to enter."""

    def __init__(self, steps: Steps, branch: _Branch) -> None:
        self._steps, self._branch = steps, branch
        self.states: set[int] = set()
        self.default: set[int] = set()
        self.histories: dict[int, list[Any]] = {}
        """Default actions of histories without memory, by parent."""

    def enter_inside(self, state: State) -> None:
        """Enter a state and its default inner states."""
        if state.kind == "history":
            self._history(state)
            return
        self.states.add(state.order)
        if state.kind == "parallel":
            self._regions(state)
        elif state.is_compound:
            assert state.initial is not None
            self.default.add(state.order)
            self._enter_all(self._steps._edges[id(state.initial)].targets, state)

    def _history(self, state: State) -> None:
        parent, initial = state.parent, state.initial
        assert parent is not None
        assert initial is not None
        remembered = self._branch.remembered.get(state.order)
        if remembered is not None:
            self._enter_all([self._steps._states[order] for order in remembered], parent)
            return
        self.histories.setdefault(parent.order, []).append(initial.actions)
        self._enter_all(self._steps._edges[id(initial)].targets, parent)

    def _enter_all(self, targets: Sequence[State], within: State) -> None:
        for target in targets:
            self.enter_inside(target)
        for target in targets:
            self.enter_ancestors(target, within)

    def enter_ancestors(self, state: State, domain: State) -> None:
        """Enter the ancestors of a state up to a domain, and the other regions of parallel ancestors."""
        for around in state.ancestors:
            if around is domain:
                break
            self.states.add(around.order)
            if around.kind == "parallel":
                self._regions(around)

    def _regions(self, state: State) -> None:
        for region in state.inner:
            if not any(
                order == region.order or self._steps._states[order].is_inside(region) for order in self.states
            ):
                self.enter_inside(region)


def _queue_events(
    block: Sequence[Any], internal: tuple[str, ...], external: tuple[str, ...]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return both queues after appending the events of a block of actions."""
    events = [item for item in block if isinstance(item, Event)]
    return (
        internal + tuple(event.name for event in events if event.internal),
        external + tuple(event.name for event in events if not event.internal),
    )


def _check_size(branch: _Branch) -> None:
    """Raise ValueError if a step grows without bound, before it exhausts memory."""
    if len(branch.internal) + len(branch.external) > _MOST_EVENTS:
        raise ValueError(f"more than {_MOST_EVENTS} events are queued in one step")
    if len(branch.done) > _MOST_ASSIGNMENTS:
        raise ValueError(f"one step assigns more than {_MOST_ASSIGNMENTS} numbers")


class Descriptors:
    """A set of event descriptors, matched as in `matches`."""

    def __init__(self, descriptors: Collection[str]) -> None:
        self._matches_all = "*" in descriptors
        self._prefixes = {_prefix(descriptor) for descriptor in descriptors}
        self._lengths = sorted({len(prefix) for prefix in self._prefixes})

    def match(self, event: str) -> bool:
        """Whether any of them matches an event."""
        return self._matches_all or any(
            event[:length] in self._prefixes and event[length : length + 1] in {"", "."}
            for length in self._lengths
            if length <= len(event)
        )


def matches(descriptor: str, event: str) -> bool:
    """Whether a descriptor matches an event: `*` matches all, `a` also `a.b`."""
    if descriptor == "*":
        return True
    prefix = _prefix(descriptor)
    return event == prefix or event.startswith(f"{prefix}.")


def _prefix(descriptor: str) -> str:
    return descriptor.removesuffix("*").removesuffix(".")
