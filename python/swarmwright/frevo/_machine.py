"""FREVO's MealyFSM as the controller mealy_fsm."""

import math
from dataclasses import dataclass

from swarmwright.frevo._document import Section

_INPUTS = 10
"""What an agent of Emergency Exit senses."""
_MOST_LEVELS = 1001


@dataclass(frozen=True)
class MachineOptions:
    """Options of mealy_fsm, what is not taken over of FREVO's entries, and what the person should know."""

    states: int
    levels: list[list[float]]
    output_levels: int
    not_taken: list[str]
    notes: list[str]


def take_machine(section: Section) -> MachineOptions:
    """Read every entry of a MealyFSM.

    Raises InputError for one that cannot be read, or lists of another length than there are inputs.
    """
    states = section.take_integer("num_of_states", 6, 1)
    lowest, highest = (_numbers(section, f"{name}_input_values") for name in ("min", "max"))
    units = _numbers(section, "unit_input_values")
    counts = _numbers(section, "nthresholds_for_inputs", least=0)
    for index, (low, high) in enumerate(zip(lowest, highest, strict=True)):
        if low >= high:
            raise section.error(
                "max_input_values", f"{high} found for input {index}, expected more than the smallest, {low}"
            )
    output_units = section.take_integer("output_units", 100, 1)
    output_levels = output_units + 1 if output_units < _MOST_LEVELS else 0
    fixed = "thresholds lie evenly between smallest and largest value, and do not evolve"
    not_taken = [f"threshold_units = {section.shown('threshold_units')}: {fixed}"]
    own_rows = "FREVO looks rows up by a product of intervals, so that several inputs share one"
    notes = [
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
    levels = [_thresholds(*of_one) for of_one in zip(lowest, highest, units, counts, strict=True)]
    return MachineOptions(states, levels, output_levels, not_taken, notes)


def _numbers(section: Section, key: str, least: int = -(2**24)) -> list[int]:
    text = section.shown(key)
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != _INPUTS or not all(least <= number <= 2**24 for number in numbers):
        raise section.error(
            key, f"{text!r} found, expected {_INPUTS} whole numbers with commas between, one for each input"
        )
    return numbers


def _thresholds(low: int, high: int, units: int, count: int) -> list[float]:
    """Return where intervals end: half below FREVO's thresholds, as whole numbers at these are above them."""
    parts, last = (count + 1, count) if count else (max(units, 1), max(units, 1))
    return sorted({math.ceil(low + (high - low) * k / parts) - 0.5 for k in range(1, last + 1)})
