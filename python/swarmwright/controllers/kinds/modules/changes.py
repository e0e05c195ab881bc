"""Changes of machines of modules: of many genomes at once, with a stream of random numbers for each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.random_numbers import Stream

_MOVE, _MORE, _LESS, _CHOICE = range(4)
_Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class Layout:
    """Where the genes of machines are, and what they mean.

    sets_state, sets_transition: of each behaviour and of each condition, which genes of a state or of a
    transition count. counted: of each gene, whether its whole part counts. lower, upper: bounds.
    """

    states: int
    transitions: int
    tree: bool
    sets_state: NDArray[np.bool_]
    sets_transition: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    lower: _Numbers
    upper: _Numbers


class Changes:
    """All changes that are possible, in the order in which they are counted: kind and gene of each."""

    def __init__(self, layout: Layout) -> None:
        self._of = layout
        self._behaviours, self._first = layout.sets_state.shape
        self._conditions, self._each = layout.sets_transition.shape
        self._width = self._first + layout.transitions * self._each
        slots = [(_MORE, 0, layout.states), (_LESS, 0, layout.states)]
        for state in range(layout.states):
            slots += self._of_state(1 + state * self._width)
        self._kinds, self._genes, self._most = (np.array(part) for part in zip(*slots, strict=True))
        self._moved = [place for place in range(1, self._first) if place != 3]
        """Places of the parameters of behaviours in a state; those of conditions are all from 2 on."""

    def _of_state(self, at: int) -> list[tuple[int, int, int]]:
        most = self._of.transitions
        slots = [(_CHOICE, at, self._behaviours)]
        slots += [(_MOVE, at + place, 0) for place in range(1, self._first) if place != 3]
        slots += [(_MORE, at + 3, most), (_LESS, at + 3, most)]
        for k in range(most):
            here = at + self._first + k * self._each
            slots += [(_CHOICE, here, 0), (_CHOICE, here + 1, self._conditions)]
            slots += [(_MOVE, here + place, 0) for place in range(2, self._each)]
        return slots

    def make(self, genomes: _Numbers, streams: Sequence[Stream], severities: _Numbers) -> None:
        """Make one change of each genome, in place: one of all that are possible, if there is one.

        Args:
            genomes: (n, genes).
            streams: one for each genome, drawn from in turn.
            severities: (n,).
        """
        states = np.clip(genomes[:, 0].astype(np.int64), 1, self._of.states)
        possible = self._possible(genomes, states)
        # Places of all that are possible, those of a genome one after another.
        places = np.flatnonzero(possible)
        ends = np.cumsum(possible.sum(axis=1))
        begin = 0
        for row, (stream, end) in enumerate(zip(streams, ends.tolist(), strict=True)):
            if end > begin:
                slot = int(places[begin + stream.integer(end - begin)]) - row * possible.shape[1]
                self._apply(genomes[row], slot, stream, float(severities[row]), int(states[row]))
            begin = end

    def _possible(self, genomes: _Numbers, states: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which changes are possible, (n, changes)."""
        of, count = self._of, len(genomes)
        found = np.zeros((count, len(self._kinds)), dtype=np.bool_)
        if of.states > 1:
            found[:, 0], found[:, 1] = states < of.states, states > 1
        rows = genomes[:, 1:].reshape(count, of.states, self._width)
        parts = found[:, 2:].reshape(count, of.states, -1)
        there = np.arange(of.states) < states[:, np.newaxis]
        parts[..., 0] = there & (self._behaviours > 1)
        behaviours = np.minimum(rows[..., 0].astype(np.int64), self._behaviours - 1)
        after = 1 + len(self._moved)
        parts[..., 1:after] = of.sets_state[behaviours][..., self._moved] & there[..., np.newaxis]
        there &= (states > 1)[:, np.newaxis] | of.tree
        taken = np.ones(there.shape, dtype=np.int64)
        if not of.tree:
            taken = np.clip(rows[..., 3].astype(np.int64), 0, of.transitions)
            parts[..., after] = there & (taken < of.transitions)
            parts[..., after + 1] = there & (taken > 1)
        transitions = rows[..., self._first :].reshape(count, of.states, of.transitions, self._each)
        inner = parts[..., after + 2 :].reshape(count, of.states, of.transitions, self._each)
        used = there[..., np.newaxis] & (np.arange(of.transitions) < taken[..., np.newaxis])
        inner[..., 0] = used & ((states > 2) & (not of.tree))[:, np.newaxis, np.newaxis]
        inner[..., 1] = used & (self._conditions > 1)
        conditions = np.minimum(transitions[..., 1].astype(np.int64), self._conditions - 1)
        inner[..., 2:] = of.sets_transition[conditions][..., 2:] & used[..., np.newaxis]
        parts[..., after + 2 :] = inner.reshape(*parts.shape[:2], -1)
        found[:, 2:] = parts.reshape(count, -1)
        return found

    def _apply(self, genome: _Numbers, slot: int, stream: Stream, severity: float, states: int) -> None:
        """Make a change, in place."""
        kind, gene, most = int(self._kinds[slot]), int(self._genes[slot]), int(self._most[slot])
        lower, upper = float(self._of.lower[gene]), float(self._of.upper[gene])
        value = float(genome[gene])
        if kind == _MOVE:
            value = self._moved_to(value, gene, stream, severity)
        elif kind == _CHOICE:
            most = most or states - 1  # of a target
            value = (int(value) % most + 1 + stream.integer(most - 1)) % most + 0.5
        else:
            whole = min(max(int(value), 0), most)
            value = max(1, whole + (1 if kind == _MORE else -1)) + 0.5
        genome[gene] = min(max(value, lower), upper)

    def _moved_to(self, value: float, gene: int, stream: Stream, severity: float) -> float:
        """Return a parameter moved uniformly, reflected at its limits; by 1 at least if counted."""
        lower, upper = float(self._of.lower[gene]), float(self._of.upper[gene])
        step = float(stream.uniform(np.array([min(severity, 1.0) * (upper - lower)]))[0])
        if self._of.counted[gene] and abs(step) < 1:
            step = 1.0 if step >= 0 else -1.0
        value += step
        if value > upper:
            value = 2 * upper - value
        if value < lower:
            value = 2 * lower - value
        return value
