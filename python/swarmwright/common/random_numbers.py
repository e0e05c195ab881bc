"""Random numbers by counter, the same bits on every machine.

A stream is addressed by (seed, purpose, generation, candidate) and never shared, so a number does not depend
on other draws. The raw 64-bit words are Philox 4x64-10 (Salmon et al., "Parallel
random numbers: as easy as 1, 2, 3", SC 2011) with key = (seed, purpose) and counter = (block, candidate,
generation, 0), where a purpose's key is the first eight bytes, little-endian, of its name's SHA-256 and
blocks are counted from 1. Everything above the raw words is done with exact integer operations and single
IEEE binary64 operations. The engine implements it, for one stream or for many that differ in the candidate.
"""

from swarmwright import _engine

__all__ = ["Stream", "Streams"]

Stream = _engine.Stream
Streams = _engine.Streams

# The first array initializes NumPy's interface in the engine. Do it now: a signal handler that raises
# meanwhile, such as Ctrl-C in the first long computation, would leave the engine unusable.
Streams(0, "first array", 0, [0]).units(1)
