"""Shared array types, conversions, and the order of candidates by fitness."""

import numbers
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.errors import InputError

_LARGEST_BINARY32 = float(np.finfo(np.float32).max)


def float32_of(name: str, values: ArrayLike) -> NDArray[np.float32]:
    """Return an argument as an array of 32-bit floats; NaN and infinities are kept.

    Raises InputError for values that are not real numbers, for masks, and for numbers that are too large.
    """
    if _is_masked(values):
        raise InputError(f"{name}: must be an array without a mask; write {name}.filled(..)")
    try:
        values = np.asarray(values)
        if values.dtype == np.float32:
            return values
        if values.dtype.kind == "O":
            wrong = [number for number in values.flat if not _is_number(number)]
            if wrong:
                raise TypeError(f"it holds an object of the class {type(wrong[0]).__name__}")
            values = values.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: must be an array of numbers: {error}") from error
    if values.dtype.kind not in "biuf":
        raise InputError(f"{name}: must be an array of numbers, not of the type {values.dtype}")
    with np.errstate(over="raise"):
        try:
            return values.astype(np.float32)
        except FloatingPointError:
            pass
    index = next(iter(np.argwhere(np.isfinite(values) & (np.abs(values) > _LARGEST_BINARY32)).tolist()))
    raise InputError(
        f"{name}: {values[tuple(index)]:g} at {index} is too large for a 32-bit float, at most "
        f"{_LARGEST_BINARY32:g}"
    )


def shortest(genome: NDArray[np.float32]) -> list[float]:
    """Return float32 numbers as Python floats whose shortest decimals read back as the same float32."""
    # As plain str: float() of a NumPy string may swallow a KeyboardInterrupt.
    return [float(text) for text in genome.astype(np.float32).astype(str).tolist()]


def _is_masked(values: object) -> bool:
    return isinstance(values, np.ma.MaskedArray) or (
        isinstance(values, list | tuple) and any(isinstance(array, np.ma.MaskedArray) for array in values)
    )


def _is_number(value: object) -> bool:
    """Return whether an object is a number that converts to float; includes Decimal, no `numbers.Real`."""
    return isinstance(value, numbers.Number) and not (
        isinstance(value, numbers.Complex) and not isinstance(value, numbers.Real)
    )


def read_only_array(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only, and return it."""
    array.flags.writeable = False
    return array


Fitness = NDArray[np.float64]
"""Fitness of each candidate, shape (candidates,); higher is better, NaN if the evaluation failed."""
Genome = NDArray[np.float32]
"""One genome: float32, shape (genome_size,)."""
Genomes = NDArray[np.float32]
"""Several genomes: float32, shape (candidates, genome_size)."""
Limits = tuple[NDArray[np.float64], NDArray[np.float64]]
"""A lower and an upper limit for each gene: float64, shape (genome_size,) each."""


def best_first(fitness: Fitness) -> NDArray[np.intp]:
    """Return indices from the best to the worst; ties by index, failed ones (NaN) last."""
    order: NDArray[np.intp] = np.argsort(-fitness, kind="stable")  # NaN sorts last
    return order
