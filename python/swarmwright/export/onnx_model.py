"""Models of ONNX: a graph with names, units and where it comes from."""

from typing import Any

from onnx import ModelProto, TensorProto, checker, helper, numpy_helper

from swarmwright.controllers.source.in_onnx import Graph
from swarmwright.export._base import part_of
from swarmwright.export.subject import Subject

_OPSET = 17
_IR_VERSION = 8  # which belongs to that opset


def graph_of(subject: Subject) -> Graph:
    """Return the graph of a controller that steers agents. Raises InputError for an unknown kind."""
    add = part_of(subject, "onnx", "ONNX")
    graph = Graph()
    add(subject, graph)
    return graph


def model(subject: Subject, graph: Graph, name: str, words: str) -> bytes:
    """Return a model as bytes, the same ones for the same graph. `words`: where it comes from."""
    sensors, actuators = len(subject.sensors), len(subject.actuators)
    inputs = [helper.make_tensor_value_info("sensors", TensorProto.FLOAT, ["agents", sensors])]
    outputs = [helper.make_tensor_value_info("actuators", TensorProto.FLOAT, ["agents", actuators])]
    if graph.state is not None:
        kind, shape = graph.state
        inputs.append(helper.make_tensor_value_info("state", kind, shape))
        outputs.append(helper.make_tensor_value_info("next_state", kind, shape))
    tensors = [numpy_helper.from_array(value, key) for key, value in graph.constants.items()]
    made = helper.make_graph(graph.nodes, name, inputs, outputs, tensors)
    opset = [helper.make_opsetid("", _OPSET)]
    whole: ModelProto = helper.make_model(
        made, opset_imports=opset, ir_version=_IR_VERSION, producer_name="Swarmwright", doc_string=words
    )
    properties = {
        **dict(subject.facts),
        "sensors": ", ".join(_channel(one) for one in subject.sensors),
        "actuators": ", ".join(_channel(one) for one in subject.actuators),
        **({"conversion": " ".join(subject.conversion)} if subject.conversion else {}),
        **({"step_seconds": repr(subject.step_size)} if subject.step_size else {}),
        "largest_tensor_elements": str(graph.largest_tensor_elements),
    }
    helper.set_model_props(whole, properties)
    checker.check_model(whole, full_check=True)
    data: bytes = whole.SerializeToString(deterministic=True)
    return data


def _channel(channel: Any) -> str:  # noqa: ANN401 - a Channel
    unit = f" in {channel.unit}" if channel.unit else ""
    return f"{channel.name}{unit} ({channel.limits})"
