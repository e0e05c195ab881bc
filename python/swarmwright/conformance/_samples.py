"""Samples of normal distributions, and the genomes that servers make from them."""

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.json_text import Json
from swarmwright.common.random_numbers import Streams
from swarmwright.conformance._server_under_test import Server

NORMAL = "normal"
REAL = ("layered", "fully_meshed", "evostick", "hebbian")
"""Kinds of controller of which every weight may be any number."""
ROWS = ("center", "deviation", "middle", "reach", "lower", "upper")


def makes_samples(server: Server, architecture: Json) -> bool:
    """Whether the server announces that it makes such genomes itself."""
    announced = server.announced.get("distributions")
    return isinstance(announced, list) and NORMAL in announced and architecture.get("kind") in REAL


def sample_of(weights: int, candidates: int) -> Json:
    """A sample of so many candidates; some weights are at their limits."""
    genes = np.arange(weights)
    rows = {
        "center": np.sin(genes),
        "deviation": 0.25 + 0.5 * (genes % 3),
        "middle": 0.1 * (genes % 2),
        "reach": np.full(weights, 1.5),
        "lower": np.full(weights, -1.25),
        "upper": np.full(weights, 1.0),
    }
    return {
        "distribution": NORMAL,
        "seed": 5,
        "purpose": "conformance.sample",
        "generation": 2,
        # From the second of a pair on.
        "first": 3,
        "count": candidates,
        "mirrored": True,
        **{name: row.astype("<f8").tobytes() for name, row in rows.items()},
    }


def genomes_of(sample: Json) -> NDArray[np.float32]:
    """(count, weights): what protocol.md, Samples, makes of a mirrored sample."""
    center, deviation, middle, reach, lower, upper = (np.frombuffer(sample[name], "<f8") for name in ROWS)
    candidates = np.arange(sample["first"], sample["first"] + sample["count"])
    streams = Streams(sample["seed"], sample["purpose"], sample["generation"], (candidates // 2).tolist())
    away = deviation * streams.normals(len(center)).astype(np.float64)
    point = np.where(candidates[:, None] % 2, center - away, center + away)
    genomes: NDArray[np.float32] = np.clip(middle + reach * point, lower, upper).astype(np.float32)
    return genomes


def wrong_samples(weights: int, candidates: int) -> list[tuple[str, Json]]:
    """Samples that are to be refused, each with the field that is wrong."""
    sound = sample_of(weights, candidates)
    nan = np.full(weights, np.nan).tobytes()
    changed = {
        "distribution": "abacus",
        "reach": sound["reach"][:-8],
        "deviation": nan,
        "upper": np.full(weights, 1e39).tobytes(),
        "first": 2**64 - 1,
        "count": 2**32,
    }
    wrong = [(f"sample.{field}", {**sound, field: value}) for field, value in changed.items()]
    missing = {key: value for key, value in sound.items() if key != "center"}
    return [*wrong, ("sample.center", missing), ("sample.center", sample_of(weights + 1, candidates))]
