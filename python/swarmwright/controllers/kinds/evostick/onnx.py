"""EvoStick's network as a graph of ONNX, which is that of a layered one."""

from swarmwright.controllers.kinds.evostick.code import layered
from swarmwright.controllers.kinds.layered.onnx import add as add_layered
from swarmwright.controllers.source import Evolved
from swarmwright.controllers.source.in_onnx import Graph


def add(controller: Evolved, graph: Graph) -> None:
    """Add the controller to a graph."""
    add_layered(layered(controller), graph)
