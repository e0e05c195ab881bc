"""ONNX models: `--to onnx`."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError, RunError
from swarmwright.controllers.source.in_onnx import Graph
from swarmwright.export._base import Exporter, Files, NotInstalledError, find_generator, format_facts, render
from swarmwright.export.golden import Golden
from swarmwright.export.programs import run
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

_OPSET = 17
_IR_VERSION = 8  # of this opset
_MOST_ELEMENTS = 20_000_000
"""Largest number of elements of the largest intermediate tensor of a batch."""


class Onnx(Exporter):
    """`PREFIX.onnx`, a model of opset 17, and a self-test that runs it with onnxruntime.

    Inputs: `sensors`, (agents, sensors), and for controllers with a state `state`, zeros at the start of an
    episode. Outputs: `actuators` and `next_state`, the state of the next step. Sums have the order of the
    simulation, so that a runtime without fusing and reordering gives the same bits.
    """

    form: ClassVar[str] = "onnx"
    tolerance: ClassVar[float] = 1e-5
    refuses: ClassVar[bool] = False

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the model and its self-test."""
        if not subject.steers:
            raise InputError(
                "controller: a parameter set has no inputs and outputs for an ONNX model; export it to c, "
                "cpp, python or micropython"
            )
        _need("onnx")
        graph = _build_graph(subject)
        data = _model(subject, graph, prefix, format_facts(subject, ""))
        return {f"{prefix}.onnx": data, f"{prefix}_onnx_test.py": _test(subject, graph, prefix)}

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Step the model with onnxruntime, many sequences at once."""
        session = _session(folder / f"{prefix}.onnx")
        states = {node.name: node for node in session.get_inputs() if node.name == "state"}
        starts = np.flatnonzero(sequences.first)
        lengths = np.diff([*starts.tolist(), len(sequences)])
        together = max(1, _MOST_ELEMENTS // _elements(session))
        actuators = np.zeros_like(sequences.actuators)
        for begin in range(0, len(starts), together):
            part = slice(begin, begin + together)
            _step_all(session, states, (starts[part], lengths[part]), sequences.sensors, actuators)
        return actuators

    def self_test(self, folder: Path, prefix: str) -> str:
        """Run `PREFIX_onnx_test.py`."""
        name = f"{prefix}_onnx_test.py"
        output = run([sys.executable, name], folder, f"the self-test {name}")
        if not output.startswith(b"ok"):
            raise RunError(f"verification: the self-test {name} printed {output!r}, expected ok")
        return name


def _build_graph(subject: Subject) -> Graph:
    """Return the graph of a controller that steers agents. Raises InputError for an unknown kind."""
    add = find_generator(subject, "onnx", "ONNX")
    graph = Graph()
    add(subject, graph)
    return graph


def _model(subject: Subject, graph: Graph, name: str, words: str) -> bytes:
    """Serialize a model, the same bytes for the same graph. words: its origin."""
    from onnx import ModelProto, TensorProto, checker, helper, numpy_helper  # noqa: PLC0415 - optional

    sensors, actuators = len(subject.sensors), len(subject.actuators)
    inputs = [helper.make_tensor_value_info("sensors", TensorProto.FLOAT, ["agents", sensors])]
    outputs = [helper.make_tensor_value_info("actuators", TensorProto.FLOAT, ["agents", actuators])]
    if graph.state is not None:
        kind, shape = helper.np_dtype_to_tensor_dtype(np.dtype(graph.state[0])), graph.state[1]
        inputs.append(helper.make_tensor_value_info("state", kind, shape))
        outputs.append(helper.make_tensor_value_info("next_state", kind, shape))
    nodes = [
        helper.make_node(
            node.operator, list(node.inputs), [node.result], name=f"{node.result}_node", **node.attributes
        )
        for node in graph.nodes
    ]
    tensors = [numpy_helper.from_array(value, key) for key, value in graph.constants.items()]
    graph_proto = helper.make_graph(nodes, name, inputs, outputs, tensors)
    opset = [helper.make_opsetid("", _OPSET)]
    whole: ModelProto = helper.make_model(
        graph_proto,
        opset_imports=opset,
        ir_version=_IR_VERSION,
        producer_name="Swarmwright",
        doc_string=words,
    )
    properties = {
        **dict(subject.facts),
        "sensors": ", ".join(_channel(sensor) for sensor in subject.sensors),
        "actuators": ", ".join(_channel(actuator) for actuator in subject.actuators),
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


def _need(*modules: str) -> None:
    from importlib.util import find_spec  # noqa: PLC0415 - beside its use

    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise NotInstalledError(f"ONNX models need {' and '.join(missing)}: pip install 'swarmwright[onnx]'")


def _session(file: Path) -> Any:  # noqa: ANN401 - onnxruntime has no types
    _need("onnxruntime")
    import onnxruntime  # noqa: PLC0415 - optional

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # exceptions of onnxruntime
        raise RunError(f"verification: onnxruntime rejects {file.name}: {error}") from error


def _elements(session: Any) -> int:  # noqa: ANN401 - onnxruntime has no types
    return int(session.get_modelmeta().custom_metadata_map["largest_tensor_elements"])


def _step_all(
    session: Any,  # noqa: ANN401 - onnxruntime has no types
    states: Mapping[str, Any],
    sequences: tuple[NDArray[np.intp], NDArray[np.intp]],
    sensors: NDArray[np.float32],
    actuators: NDArray[np.float32],
) -> None:
    """Write the actuators of sequences, given by start and length, to the rows of `actuators`."""
    starts, lengths = sequences
    state = {}
    if states:
        weights = states["state"]
        kind = np.int64 if weights.type == "tensor(int64)" else np.float32
        state["state"] = np.zeros((len(starts), *weights.shape[1:]), kind)
    for step in range(int(lengths.max(initial=0))):
        active = np.flatnonzero(lengths > step)
        rows = starts[active] + step
        active_state = {name: values[active] for name, values in state.items()}
        outputs = session.run(None, {"sensors": sensors[rows], **active_state})
        actuators[rows] = outputs[0]
        for values in state.values():
            values[active] = outputs[1]


def _test(subject: Subject, graph: Graph, prefix: str) -> str:
    return render(
        "onnx_test.txt",
        {
            "p": prefix,
            "facts": format_facts(subject, "    "),
            **Golden.from_subject(subject).values(),
            "reset": graph.initial_state or "None",
            "state_input": ', "state": state' if graph.initial_state else "",
            "outputs": "actuators, state" if graph.initial_state else "(actuators,)",
            "tolerance": repr(Onnx.tolerance),
        },
    )
