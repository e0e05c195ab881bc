"""Normally distributed numbers from streams, the same bits on every machine."""

import numpy as np
from numpy.typing import NDArray

from swarmwright.core.random_numbers import Streams

_Numbers = NDArray[np.float64]

# Numerator and denominator, highest power first: |p - 1/2| <= 0.425, then r <= 5, then the far tails.
_CENTER = (
    (
        2509.0809287301226727,
        33430.575583588128105,
        67265.770927008700853,
        45921.953931549871457,
        13731.693765509461125,
        1971.5909503065514427,
        133.14166789178437745,
        3.387132872796366608,
    ),
    (
        5226.495278852854561,
        28729.085735721942674,
        39307.89580009271061,
        21213.794301586595867,
        5394.1960214247511077,
        687.1870074920579083,
        42.313330701600911252,
        1.0,
    ),
)
_TAIL = (
    (
        7.7454501427834140764e-4,
        0.0227238449892691845833,
        0.24178072517745061177,
        1.27045825245236838258,
        3.64784832476320460504,
        5.7694972214606914055,
        4.6303378461565452959,
        1.42343711074968357734,
    ),
    (
        1.05075007164441684324e-9,
        5.475938084995344946e-4,
        0.0151986665636164571966,
        0.14810397642748007459,
        0.68976733498510000455,
        1.6763848301838038494,
        2.05319162663775882187,
        1.0,
    ),
)
_FAR = (
    (
        2.01033439929228813265e-7,
        2.71155556874348757815e-5,
        0.0012426609473880784386,
        0.026532189526576123093,
        0.29656057182850489123,
        1.7848265399172913358,
        5.4637849111641143699,
        6.6579046435011037772,
    ),
    (
        2.04426310338993978564e-15,
        1.4215117583164458887e-7,
        1.8463183175100546818e-5,
        7.868691311456132591e-4,
        0.0148753612908506148525,
        0.13692988092273580531,
        0.59983220655588793769,
        1.0,
    ),
)
_LN2 = 0.6931471805599453


def normals(streams: Streams, count: int) -> _Numbers:
    """Return (streams, count) numbers of the standard normal distribution, |z| <= 8.3.

    The inverse of the distribution function at uniform numbers: algorithm AS 241, PPND16 (Wichura, Applied
    Statistics 37, 1988; relative error about 1e-16), in single operations of +, -, *, / and square roots,
    with a logarithm of this package, because those of C libraries differ.
    """
    return _inverse(streams.units(count) + 2.0**-54)


def _inverse(uniform: _Numbers) -> _Numbers:
    """Return the number below which a share of all lies, for shares in (0, 1)."""
    centered = uniform - 0.5
    central = np.abs(centered) <= 0.425
    result = np.empty_like(uniform)
    inner = centered[central]
    result[central] = inner * _ratio(_CENTER, 0.180625 - inner * inner)
    outer = centered[~central]
    rare = np.where(outer < 0, uniform[~central], 1.0 - uniform[~central])
    depth = np.sqrt(-_logarithm(np.maximum(rare, 2.0**-54)))
    size = np.where(depth <= 5, _ratio(_TAIL, depth - 1.6), _ratio(_FAR, depth - 5.0))
    result[~central] = np.where(outer < 0, -size, size)
    return result


def _ratio(polynomials: tuple[tuple[float, ...], tuple[float, ...]], at: _Numbers) -> _Numbers:
    top, bottom = (_polynomial(coefficients, at) for coefficients in polynomials)
    return top / bottom


def _polynomial(coefficients: tuple[float, ...], at: _Numbers) -> _Numbers:
    value = np.full_like(at, coefficients[0])
    for coefficient in coefficients[1:]:
        value = value * at + coefficient
    return value


def _logarithm(numbers: _Numbers) -> _Numbers:
    """Return natural logarithms of positive numbers: the power of two apart, then the series of artanh."""
    mantissa, exponent = np.frexp(numbers)
    low = mantissa < 0.7071067811865476
    mantissa = np.where(low, mantissa * 2.0, mantissa)
    power = np.where(low, exponent - 1, exponent).astype(np.float64)
    ratio = (mantissa - 1.0) / (mantissa + 1.0)  # at most 0.1716 in size
    series = _polynomial(tuple(1.0 / odd for odd in range(23, 0, -2)), ratio * ratio)
    return power * _LN2 + 2.0 * ratio * series
