"""The tab of genes over generations."""

import base64
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from starlette.requests import Request

from swarmwright.runs.genes import Of, gene_history
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window

LONGEST_NAME = 200


def encode(values: NDArray[Any]) -> str:
    """Return numbers as little-endian binary32 in base64, NaN for none."""
    return base64.b64encode(values.astype("<f4").tobytes()).decode()


def describe(window: Window, request: Request) -> Values:
    """Return the genes of a run over its generations."""
    of = cast("Of", request.query_params.get("of", "best"))
    history = gene_history(window.run(request), of)
    with np.errstate(over="ignore"):
        encoded = encode(history.values)
    is_single = len(history.first_genes) == history.genes
    return {
        "generations": history.generations.tolist(),
        "candidates": history.candidates.tolist(),
        "values": encoded,
        "first_genes": history.first_genes.tolist(),
        "genes": history.genes,
        "names": [name[:LONGEST_NAME] for name in history.names] if is_single else [],
    }


VIEW = View(
    "genes",
    STATIC / "genes.js",
    "Genes",
    tab_of=lambda run: run.generations > 0,
    answers={"genes": describe},
)
