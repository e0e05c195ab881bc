"""The weights of machines and trees of modules for code generation."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers.modules import grammar, machine_texts
from swarmwright.controllers.source import Evolved
from swarmwright.display.machines import Machine


def machine_weights(controller: Evolved) -> NDArray[np.float32]:
    """Return the weights of a machine or tree of modules within their limits; those not used are 0."""
    specification = controller.specification
    sizes = (int(specification["states"]), int(specification["transitions"]))
    catalogue = catalogue_of(specification)
    return np.array(grammar.weights_of(grammar.states_of(specification), *sizes, catalogue), np.float32)


def catalogue_of(specification: Mapping[str, Any]) -> grammar.Catalogue:
    """Return the engine's modules in the order of their numbers, then user modules in their order."""
    catalogue = grammar.Catalogue.from_specification(specification)
    return grammar.Catalogue(
        (*grammar.BUILT_IN.behaviours, *select_user_modules(catalogue.behaviours)),
        (*grammar.BUILT_IN.conditions, *select_user_modules(catalogue.conditions)),
    )


def select_user_modules(parts: tuple[grammar.Module, ...]) -> list[grammar.Module]:
    """Return the modules that are not the engine's."""
    return [part for part in parts if not part.built_in]


def describe(specification: Mapping[str, Any]) -> str:
    """Describe the controller by kind and form."""
    form = "behaviour tree" if grammar.is_tree(specification) else "state machine"
    return f"{specification['kind']} ({form})"


def machine(specification: Mapping[str, Any]) -> Machine:
    """Return the states and transitions, or the subtrees, in words."""
    states = grammar.states_of(specification)
    if grammar.is_tree(specification):
        return {
            "form": "tree",
            "states": [
                {
                    "name": machine_texts.name_of(subtree.behaviour),
                    "words": machine_texts.words_of(subtree),
                    "condition": machine_texts.condition_words(subtree),
                }
                for subtree in states
            ],
            "transitions": [],
        }
    return {
        "states": [
            {"name": machine_texts.name_of(state.behaviour), "words": machine_texts.words_of(state)}
            for state in states
        ],
        "transitions": [
            (index, transition.target, machine_texts.words_of(transition).partition(": ")[2])
            for index, state in enumerate(states)
            for transition in state.transitions
        ],
    }
