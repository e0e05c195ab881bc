"""The kinds of controllers, a folder each: options and genes, figure, and source code in each language.

Other packages reach a kind through its entry in `KINDS` only. The package of a kind defines its options and
its representation, `code` its source in C and Python and its ONNX graph, `figure` its drawing. All but the
representation are optional.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import InputError
from swarmwright.controllers.drawing import Drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from swarmwright.display.machines import Machine


@dataclass(frozen=True)
class Kind:
    """A kind of controller; addresses are `module:name` below `swarmwright.controllers`.

    They are imported on demand by `import_part`.
    """

    representation: str = ""
    """The class; empty for a kind whose controllers another kind's representation creates."""
    figure: str = ""
    """Returns the figure of a `Drawing`."""
    c: str = ""
    """Returns the `source.in_c.Code` of an `Evolved` controller in a language, C or C++."""
    python: str = ""
    """Returns the `source.in_python.PythonCode` of an `Evolved` controller."""
    onnx: str = ""
    """Adds an `Evolved` controller to a `source.in_onnx.Graph`."""
    words: str = "activations:describe_network"
    """Returns a specification in a few words."""
    machine: str = ""
    """Returns the `Machine` of a specification for films and pages; None if it is too large."""
    visits: str = ""
    """For kinds with tables: returns the rows that the steps of self-tests visit."""
    swarm: str = ""
    """For kinds that the engine does not step: the Python class that does."""
    stateless: bool = False
    """Whether actuators depend only on the sensors of the same step."""
    overflows: bool = False
    """Whether nodes can become NaN, which lasts until a reset."""
    random_sensor: int | None = None
    """Index of the sensor that is a random number from 0 to 1."""


def import_part(address: str) -> Any:  # noqa: ANN401 - as the field of `Kind` says
    """Import a part of a kind by its address."""
    module, _, name = address.partition(":")
    return getattr(import_module(f"swarmwright.controllers.{module}"), name)


KINDS: dict[str, Kind] = {
    "evostick": Kind(
        representation="kinds.evostick:Evostick",
        figure="kinds.evostick.figure:draw",
        c="kinds.evostick.code:c",
        python="kinds.evostick.code:python",
        onnx="kinds.evostick.code:onnx",
        stateless=True,
    ),
    "fully_meshed": Kind(
        representation="kinds.fully_meshed:FullyMeshed",
        figure="kinds.fully_meshed.figure:draw",
        c="kinds.fully_meshed.code:c",
        python="kinds.fully_meshed.code:python",
        onnx="kinds.fully_meshed.code:onnx",
        overflows=True,
    ),
    "growing": Kind(
        figure="kinds.growing.figure:draw",
        c="kinds.growing.code:c",
        python="kinds.growing.code:python",
        onnx="kinds.growing.code:onnx",
        words="kinds.growing.genes:describe",
    ),
    "hebbian": Kind(
        representation="kinds.hebbian:Hebbian",
        figure="kinds.hebbian.figure:draw",
        c="kinds.hebbian.code:c",
        python="kinds.hebbian.code:python",
        overflows=True,
    ),
    "hyperneat": Kind(representation="kinds.hyperneat:Hyperneat"),
    "layered": Kind(
        representation="kinds.layered:Layered",
        figure="kinds.layered.figure:draw",
        c="kinds.layered.code:c",
        python="kinds.layered.code:python",
        onnx="kinds.layered.code:onnx",
        stateless=True,
    ),
    "mealy_fsm": Kind(
        representation="kinds.mealy_fsm:MealyFsm",
        figure="kinds.mealy_fsm.figure:draw",
        c="kinds.mealy_fsm.code:c",
        python="kinds.mealy_fsm.code:python",
        onnx="kinds.mealy_fsm.code:onnx",
        words="kinds.mealy_fsm.tables:describe",
        machine="kinds.mealy_fsm.tables:machine",
        visits="kinds.mealy_fsm.tables:visits",
    ),
    "modules": Kind(
        representation="kinds.modules.representation:Modules",
        figure="kinds.modules.figure:draw",
        c="kinds.modules.code:c",
        python="kinds.modules.code:python",
        words="kinds.modules.tables:describe",
        machine="kinds.modules.tables:machine",
        random_sensor=8,
    ),
    "neat": Kind(
        representation="kinds.neat:Neat",
        figure="kinds.neat.figure:draw",
        c="kinds.neat.code:c",
        python="kinds.neat.code:python",
    ),
    "parameter_set": Kind(
        representation="kinds.parameter_set:ParameterSet",
        figure="kinds.parameter_set.figure:draw",
    ),
    "python_modules": Kind(
        figure="kinds.modules.figure:draw",
        c="kinds.modules.code:c",
        python="kinds.modules.code:python",
        words="kinds.modules.tables:describe",
        machine="kinds.modules.tables:machine",
        swarm="modules.machine:Swarm",
        random_sensor=8,
    ),
    "team": Kind(
        representation="kinds.team:Team",
        figure="kinds.team.figure:draw",
        words="kinds.team:describe",
    ),
}
"""Kinds of controller by the `kind` of a specification, see protocol/schemas/controller.schema.json."""


def kind_of(specification: Mapping[str, Any]) -> Kind:
    """Return the kind of a specification; a `Kind` without parts if it is unknown."""
    return KINDS.get(str(specification.get("kind")), Kind())


def describe_controller(specification: Mapping[str, Any]) -> str:
    """Describe a controller in a few words: `layered, 4-8-1, tanh`; `modules (behaviour tree)`."""
    return str(import_part(kind_of(specification).words)(specification))


def draw_controller(drawing: Drawing) -> "Figure":
    """Return the figure of a controller. Raises InputError for kinds that cannot be drawn."""
    draw = kind_of(drawing.specification).figure
    if not draw:
        raise InputError(f"controller: the kind {drawing.specification.get('kind')!r} cannot be drawn")
    figure: Figure = import_part(draw)(drawing)
    return figure


def machine_of(specification: Mapping[str, Any]) -> "Machine | None":
    """Return the state machine of a controller other than a team; None if it has none."""
    address = kind_of(specification).machine
    machine: Machine | None = import_part(address)(specification) if address else None
    return machine
