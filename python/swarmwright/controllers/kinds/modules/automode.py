"""Machines and trees of modules as command lines of AutoMoDe.

A machine: `--fsm-config --nstates 2 --s0 4 --att0 5 ..`. A tree, as AutoMoDe-Maple designs them: `--bt-config
--nroot 3 --nchildroot 1 --n0 0 --nchild0 2 --n00 6 --c00 5 --p00 0.26 --n01 5 --a01 1 --p01 0`.
"""

import shlex
from collections.abc import Sequence
from itertools import takewhile
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.controllers.modules.grammar import (
    BEHAVIOUR_PARAMETERS,
    BEHAVIOURS,
    CONDITIONS,
    MOST_STATES,
    MOST_SUBTREES,
    MOST_TRANSITIONS,
    State,
    Transition,
)

_SHORT_NAMES = {"exploration": "rwm", "attraction": "att", "repulsion": "rep"}
"""AutoMoDe's names of the behaviours' parameters."""
_MACHINE, _TREE = "--fsm-config", "--bt-config"
_SHELL = ("|", ">", "&", ";")
"""Prefixes of words that end a program's arguments in a shell."""
_NODES = {
    0: "a selector", 1: "a selector with memory", 2: "a sequence", 3: "a sequence with memory",
    4: "a negation", 5: "an action", 6: "a condition",
}  # fmt: skip
_SELECTOR, _SEQUENCE, _ACTION, _CONDITION = 0, 3, 5, 6


def is_command_line(text: str) -> bool:
    """Whether a text is a command line of AutoMoDe's programs, or its parameters, and not a path."""
    return text.lstrip().startswith("--") or _MACHINE in text or _TREE in text


def parse_machine(text: str) -> dict[str, Any]:
    """Return a machine as a mapping, see `machine_mappings.states_from`.

    Raises InputError for invalid text.
    """
    if _is_tree(text):
        raise InputError("AutoMoDe's --bt-config describes a tree; set form: tree")
    values = _Values(_parameters_of(text, _MACHINE))
    count = values.choice("nstates", MOST_STATES + 1)
    states = []
    for index in range(count):
        behaviour = BEHAVIOURS[values.choice(f"s{index}", len(BEHAVIOURS))]
        state: dict[str, Any] = {"behaviour": behaviour}
        if behaviour in _SHORT_NAMES:
            state[BEHAVIOUR_PARAMETERS[behaviour]] = values.whole(f"{_SHORT_NAMES[behaviour]}{index}")
        transitions = values.choice(f"n{index}", MOST_TRANSITIONS + 1, "0")
        targets = [_transition(values, index, f"{index}x{k}", count) for k in range(transitions)]
        states.append({**state, "transitions": [target for target in targets if target]})
    values.end()
    return {"states": states}


def _transition(values: "_Values", source: int, suffix: str, states: int) -> dict[str, Any]:
    """Return a transition; empty if its target does not exist, which AutoMoDe ignores."""
    target = values.choice(f"n{suffix}", MOST_STATES)
    condition = CONDITIONS[values.choice(f"c{suffix}", len(CONDITIONS))]
    parameters = _parameters(values, condition, suffix)
    if target >= states - 1:
        return {}
    # Targets are indices among the other states.
    return {"to": target + (target >= source), "condition": condition, **parameters}


def _parameters(values: "_Values", condition: str, suffix: str) -> dict[str, Any]:
    """Return the parameters of a condition."""
    if "neighbours" in condition:
        return {"xi": values.whole(f"p{suffix}"), "eta": values.number(f"w{suffix}")}
    probability = values.number(f"p{suffix}")
    values.number(f"w{suffix}", "0")
    return {"probability": probability}


def parse_tree(text: str) -> dict[str, Any]:
    """Return a tree as a mapping, see `machine_mappings.subtrees_from`. Raises InputError for invalid text.

    Only the trees of AutoMoDe-Maple are supported: a sequence with memory of selectors, each with a condition
    and an action that never succeeds.
    """
    if not _is_tree(text):
        raise InputError("AutoMoDe's --fsm-config describes a machine; leave out form: tree")
    values = _Values(_parameters_of(text, _TREE))
    values.node("nroot", _SEQUENCE)
    subtrees = []
    for index in range(values.choice("nchildroot", MOST_SUBTREES + 1)):
        values.node(f"n{index}", _SELECTOR)
        if values.choice(f"nchild{index}", 1000) != 2:
            raise InputError(f"--nchild{index}: expected 2, a condition and an action")
        suffix = f"{index}0"
        values.node(f"n{suffix}", _CONDITION)
        condition = CONDITIONS[values.choice(f"c{suffix}", len(CONDITIONS))]
        subtree: dict[str, Any] = {"condition": condition, **_parameters(values, condition, suffix)}
        suffix = f"{index}1"
        values.node(f"n{suffix}", _ACTION)
        behaviour = BEHAVIOURS[values.choice(f"a{suffix}", len(BEHAVIOURS))]
        subtree["behaviour"] = behaviour
        if behaviour in _SHORT_NAMES:
            subtree[BEHAVIOUR_PARAMETERS[behaviour]] = values.whole(f"{_SHORT_NAMES[behaviour]}{suffix}")
        if values.number(f"p{suffix}", "0") != 0:
            raise InputError(f"--p{suffix}: actions that may succeed are not supported; expected 0")
        subtrees.append(subtree)
    values.end()
    return {"subtrees": subtrees}


def format_command_line(states: Sequence[State], *, tree: bool) -> str | None:
    """Return a machine or a tree as AutoMoDe's programs take it.

    None if they cannot represent it: another module, or a transition from a state to itself.
    """
    conditions = [transition.condition for state in states for transition in state.transitions]
    is_automode = {state.behaviour for state in states} <= set(BEHAVIOURS) and set(conditions) <= set(
        CONDITIONS
    )
    ways = [
        (index, transition.target) for index, state in enumerate(states) for transition in state.transitions
    ]
    if not tree and any(source == target for source, target in ways):
        return None
    if not is_automode:
        return None
    words = [_TREE, "--nroot 3", f"--nchildroot {len(states)}"]
    if not tree:
        words = [_MACHINE, f"--nstates {len(states)}"]
    for index, state in enumerate(states):
        words += _subtree_words(index, state) if tree else _state_words(index, state)
    return " ".join(words)


def _state_words(index: int, state: State) -> list[str]:
    words = [f"--s{index} {BEHAVIOURS.index(state.behaviour)}", *_behaviour_words(state, str(index))]
    words.append(f"--n{index} {len(state.transitions)}")
    for k, transition in enumerate(state.transitions):
        # Targets are indices among the other states.
        words.append(f"--n{index}x{k} {transition.target - (transition.target > index)}")
        words += _condition_words(transition, f"{index}x{k}")
    return words


def _subtree_words(index: int, state: State) -> list[str]:
    (transition,) = state.transitions
    words = [f"--n{index} {_SELECTOR}", f"--nchild{index} 2", f"--n{index}0 {_CONDITION}"]
    words += _condition_words(transition, f"{index}0")
    words += [f"--n{index}1 {_ACTION}", f"--a{index}1 {BEHAVIOURS.index(state.behaviour)}"]
    return [*words, *_behaviour_words(state, f"{index}1"), f"--p{index}1 0"]


def _behaviour_words(state: State, suffix: str) -> list[str]:
    return [f"--{_SHORT_NAMES[state.behaviour]}{suffix} {value}" for value in state.parameters.values()]


def _condition_words(transition: Transition, suffix: str) -> list[str]:
    names = {"probability": "p", "xi": "p", "eta": "w"}
    words = [f"--{names[name]}{suffix} {value!r}" for name, value in transition.parameters.items()]
    return [f"--c{suffix} {CONDITIONS.index(transition.condition)}", *words]


def _is_tree(text: str) -> bool:
    words = _words(text)
    return _TREE in words or "--nroot" in words


def _words(text: str) -> list[str]:
    """Split a command line, which may go over several lines, into its words, without quotes."""
    try:
        return " ".join(shlex.split(text)).split()
    except ValueError as error:  # a quote that is not closed
        raise InputError(f"{text[:60]!r}: {error}") from None


def _parameters_of(text: str, option: str) -> list[str]:
    """Return the parameters after an option of AutoMoDe's programs, or all words without the option.

    Words before the option, `automode_main -c mission.argos --seed 3`, describe the experiment; words after
    `|` or `>` belong to the shell.
    """
    words = _words(text)
    if option in words:
        words = words[words.index(option) + 1 :]
    return list(takewhile(lambda word: not word.startswith(_SHELL), words))


class _Values:
    """The parameters that have not been read yet."""

    def __init__(self, words: list[str]) -> None:
        text = " ".join(words)
        if len(words) % 2 or any(not name.startswith("--") for name in words[::2]):
            raise InputError(f"{text[:60]!r}: expected pairs such as --nstates 2 --s0 4 --att0 5")
        self._values = dict(zip(words[::2], words[1::2], strict=True))
        if len(self._values) < len(words) // 2:
            raise InputError(f"{text[:60]!r}: a parameter occurs twice")

    def number(self, name: str, default: str | None = None) -> float:
        """Return a number."""
        text = self._values.pop(f"--{name}", default)
        if text is None:
            raise InputError(f"--{name}: is missing; expected a number")
        try:
            return float(text)
        except ValueError:
            raise InputError(f"--{name}: {text!r} found, expected a number") from None

    def whole(self, name: str) -> int:
        """Return the whole part of a number, as AutoMoDe takes it."""
        number = self.number(name)
        if not abs(number) < 1e9:  # NaN and infinity among others
            raise InputError(f"--{name}: {number:g} is out of range; expected a number below 1e9")
        return int(number)

    def choice(self, name: str, count: int, default: str | None = None) -> int:
        """Return an integer below `count`."""
        number = self.number(name, default)
        if not 0 <= number < count or number != int(number):
            raise InputError(f"--{name}: {number:g} found, expected an integer from 0 to {count - 1}")
        return int(number)

    def node(self, name: str, expected: int) -> None:
        """Check the kind of a node of a tree."""
        node = self.choice(name, len(_NODES))
        if node != expected:
            raise InputError(
                f"--{name}: {node} is {_NODES[node]}; expected {expected}, {_NODES[expected]}, as in the "
                "trees of AutoMoDe-Maple"
            )

    def end(self) -> None:
        """Raise InputError for parameters that were not read."""
        if self._values:
            raise InputError(f"{next(iter(self._values))}: is not a parameter of this machine")
