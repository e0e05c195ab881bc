"""FREVO's MealyFSM as the controller mealy_fsm."""

import math
from dataclasses import dataclass

from swarmwright.interop.frevo._document import Section

_MOST_LEVELS = 1001
_DEFAULTS = {
    "min_input_values": [0, 0],
    "max_input_values": [70, 70],
    "unit_input_values": [70, 70],
    "nthresholds_for_inputs": [3, 3],
}
"""What FREVO has where an entry is left out: for two inputs, whatever the problem has."""
_FALLBACK = (0, 100, 100, 1)
"""Smallest and largest value, units and thresholds of each input where the lists do not fit their number."""
_COUNTED = 4
"""Values of an input up to which it has no thresholds where `nthresholds_for_inputs` does not fit."""


@dataclass(frozen=True)
class MachineOptions:
    """Options of mealy_fsm, entries of FREVO's that are not taken over, and notes for the user."""

    states: int
    levels: list[list[float]]
    output_levels: int
    not_taken: list[str]
    notes: list[str]


def take_machine(section: Section, sensors: int | None) -> MachineOptions:
    """Read every entry of a MealyFSM.

    sensors: inputs of the problem; None where that is not known and the entries say it.

    Raises InputError for one that cannot be read, or lists of another length than there are inputs.
    """
    states = section.take_integer("num_of_states", 6, 1)
    inputs, notes = _inputs(section, sensors)
    for index, (low, high, _, _) in enumerate(inputs):
        if low >= high:
            raise section.error(
                "max_input_values", f"{high} found for input {index}, expected more than the smallest, {low}"
            )
    output_units = section.take_integer("output_units", 100, 1)
    output_levels = output_units + 1 if output_units < _MOST_LEVELS else 0
    fixed = "thresholds lie evenly between smallest and largest value, and do not evolve"
    not_taken = [f"threshold_units = {section.shown('threshold_units', '100,100')}: {fixed}"]
    own_rows = "FREVO looks rows up by a product of intervals, so that several inputs share one"
    notes += [
        f"representation.nthresholds_for_inputs: {fixed}",
        f"representation.class = fsm.MealyFSM: {own_rows}; here each has its own",
    ]
    if section.take_flag("state_num_change_allowed", False):
        notes.append("representation.state_num_change_allowed = true: the number of states is fixed")
    not_taken += [
        f"{key} = {section.shown(key)}: machines begin and vary in one way"
        for key in ("state_num_change_allowed", "generation_mode", "distance_calc_method")
        if key in section.entries
    ]
    rates = [key for key in section.entries if key.startswith("mutate_")]
    if rates:
        shown = ", ".join(f"{key} = {section.shown(key)}" for key in rates)
        not_taken.append(f"{shown}: the method's severity and probability say how much is changed")
    levels = [_thresholds(*of_one) for of_one in inputs]
    return MachineOptions(states, levels, output_levels, not_taken, notes)


def _inputs(section: Section, sensors: int | None) -> tuple[list[tuple[int, int, int, int]], list[str]]:
    """Return smallest and largest value, units and thresholds of each input, and what is to be known."""
    given = {key: _numbers(section, key, sensors) for key in _DEFAULTS if key in section.entries}
    lengths = {key: len(numbers) for key, numbers in given.items()}
    count = sensors if sensors is not None else max(lengths.values(), default=2)
    for key, length in lengths.items():
        if length != count:
            raise section.error(key, f"{length} numbers found, where another list has {count}")
    lists = {key: given.get(key, default) for key, default in _DEFAULTS.items()}
    values = [lists[key] for key in _DEFAULTS if key != "nthresholds_for_inputs"]
    left_out = ", ".join(key for key in _DEFAULTS if key not in given)
    if any(len(numbers) != count for numbers in values):
        low, high, _, thresholds = _FALLBACK
        note = (
            f"representation.{left_out}: left out, and then FREVO takes every input for a number from {low} "
            f"to {high} with {thresholds} threshold; what is sensed may not reach it: see controller.levels"
        )
        return [_FALLBACK] * count, [note]
    counts = lists["nthresholds_for_inputs"]
    if len(counts) != count:  # two numbers for another number of inputs
        counts = [0 if units + 1 <= _COUNTED else counts[-1] for units in lists["unit_input_values"]]
    return list(zip(*values, counts, strict=True)), []


def _numbers(section: Section, key: str, expected: int | None) -> list[int]:
    text = section.shown(key)
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    least = 0 if key == "nthresholds_for_inputs" else -(2**24)
    right = len(numbers) == expected if expected is not None else bool(numbers)
    if not right or not all(least <= number <= 2**24 for number in numbers):
        many = "" if expected is None else f"{expected} "
        raise section.error(
            key, f"{text!r} found, expected {many}whole numbers with commas between, one for each input"
        )
    return numbers


def _thresholds(low: int, high: int, units: int, count: int) -> list[float]:
    """Return where intervals end: half below FREVO's thresholds, as whole numbers at these are above them."""
    parts, last = (count + 1, count) if count else (max(units, 1), max(units, 1))
    return sorted({math.ceil(low + (high - low) * k / parts) - 0.5 for k in range(1, last + 1)})
