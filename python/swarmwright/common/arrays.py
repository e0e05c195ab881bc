"""Arrays that all parts share: their types, copies, and the order of candidates by fitness."""

import numbers
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.errors import InputError

_LARGEST_BINARY32 = float(np.finfo(np.float32).max)


def float32_of(name: str, given: ArrayLike) -> NDArray[np.float32]:
    """Return an argument as an array of 32-bit floats, which may be NaN or infinite where it is.

    Raises InputError for what holds no real numbers, for a mask, and for numbers that are too large.
    """
    if _is_masked(given):
        raise InputError(f"{name}: must be an array without a mask; write {name}.filled(..)")
    try:
        values = np.asarray(given)
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
    place = next(iter(np.argwhere(np.isfinite(values) & (np.abs(values) > _LARGEST_BINARY32)).tolist()))
    raise InputError(
        f"{name}: {values[tuple(place)]:g} at {place} is too large for a 32-bit float, at most "
        f"{_LARGEST_BINARY32:g}"
    )


def shortest(genome: NDArray[np.float32]) -> list[float]:
    """Return float32 numbers as the Python floats whose shortest decimals read back as the same float32."""
    # As plain str: float() of a numpy string may swallow a KeyboardInterrupt that comes in between.
    return [float(text) for text in genome.astype(np.float32).astype(str).tolist()]


def _is_masked(given: object) -> bool:
    return isinstance(given, np.ma.MaskedArray) or (
        isinstance(given, list | tuple) and any(isinstance(array, np.ma.MaskedArray) for array in given)
    )


def _is_number(value: object) -> bool:
    """Whether an object is a number that becomes a float; Decimal is, and is no `numbers.Real`."""
    return isinstance(value, numbers.Number) and not (
        isinstance(value, numbers.Complex) and not isinstance(value, numbers.Real)
    )


def read_only_array(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array itself, which from now on cannot be changed."""
    array.flags.writeable = False
    return array


Fitness = NDArray[np.float64]
"""A number for each candidate, more is better, NaN where the evaluation failed."""
Genome = NDArray[np.float32]
"""One genome: float32, shape (genome_size,)."""
Genomes = NDArray[np.float32]
"""Several genomes: float32, shape (candidates, genome_size)."""
Limits = tuple[NDArray[np.float64], NDArray[np.float64]]
"""A lower and an upper limit for each gene: float64, shape (genome_size,) each."""


def best_first(fitness: Fitness) -> NDArray[np.intp]:
    """Return indices from the best to the worst; equal ones by index, failed ones (NaN) last, by index."""
    order: NDArray[np.intp] = np.argsort(-fitness, kind="stable")  # NaN sorts last
    return order
