"""Report the progress of an optimization to other programs.

    with TensorBoard("logs/first") as board:
        swarmwright.optimize(experiment, board)

A callback is called with each `Generation`; `together` combines several. The libraries are optional:
`pip install 'swarmwright[tensorboard]'`, `pip install 'swarmwright[mlflow]'`.
"""

from typing import Any

from swarmwright.runs.callbacks._base import Callback, together

__all__ = ["Callback", "MLflow", "TensorBoard", "together"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - PEP 562: the classes below, imported when used
    if name == "TensorBoard":
        from swarmwright.runs.callbacks._tensorboard import TensorBoard

        return TensorBoard
    if name == "MLflow":
        from swarmwright.runs.callbacks._mlflow import MLflow

        return MLflow
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
