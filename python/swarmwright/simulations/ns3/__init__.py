"""Radio communication between the agents of a simulation in Python, simulated by ns-3.

`Radios` takes the agents' positions and messages in each step and returns what arrives: with range, loss,
delay and bandwidth. ns-3 runs in the same process, `pip install 'swarmwright[ns3]'`.

Source: Riley and Henderson, The ns-3 Network Simulator, 2010, https://www.nsnam.org.

Radios use IEEE 802.11b in ad hoc mode, in lock-step with a simulation.
"""

import math
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from swarmwright.common.errors import InputError

__all__ = ["Delivery", "Radios"]

_LIBRARIES = ("core", "network", "mobility", "propagation", "wifi")
_RATES = {1.0: "DsssRate1Mbps", 2.0: "DsssRate2Mbps", 5.5: "DsssRate5_5Mbps", 11.0: "DsssRate11Mbps"}
"""Mbit/s -> ns-3's name of the mode."""
_LARGEST_MESSAGE = 2200
"""Largest size of a message in bytes: those of an 802.11 frame, less its headers."""
_LARGEST_SEED = 4294944442
"""Largest seed of ns-3's generator, MRG32k3a."""
_THRESHOLD_DBM = -82.0
"""Received power below which ns-3's radios detect no frame (ThresholdPreambleDetectionModel)."""
_LOSS_AT_ONE_METRE_DB = 40.05
"""At 2.4 GHz in free space, as in radios.cpp."""
_MOST_RADIOS = 10_000
"""Largest number of radios of a simulation."""


class Delivery(NamedTuple):
    """A message that a radio has received."""

    receiver: int
    """Index of the radio."""
    sender: int
    """Index of the radio that sent it."""
    payload: bytes
    delay: float
    """Seconds from the call of `step` in which it was sent to its reception, including the jitter."""


class Radios:
    """Radios of a swarm, which broadcast messages: IEEE 802.11b in ad hoc mode.

    The received power falls with the logarithm of the distance; frames that overlap at a receiver collide;
    radios wait while they receive others (CSMA/CA), and frames are queued. Broadcast frames are neither
    acknowledged nor repeated. The same seed and calls give the same deliveries.

    ns-3 allows a single simulation in a process: `close` radios before creating others, and set
    `copies = False` in a simulation with radios.

    Args:
        count: number of radios, 1 to 10,000.
        seed: seed of all random numbers, 0 to 2^63 - 1.
        range: metres, above 0, at which the received power falls to the threshold of -82 dBm; `power` follows
            from it.
        exponent: exponent of the path loss, 1 to 10: 2 in free space, 3 to 4 in buildings.
        fading: shape m of Nakagami fading, 0.5 to 100: 1 is Rayleigh fading, larger values vary less; 0 for
        no
            fading.
        rate: Mbit/s: 1, 2, 5.5 or 11.
        jitter: largest random delay of a message after the beginning of a step, in seconds, as robots are not
            synchronized. With 0, all radios send at the same instant and collide.

    Attributes:
        power: power of the transmitters, dBm.

    Raises InputError for values outside these ranges, if ns-3 is not installed, and if other radios are open.
    """

    _open: ClassVar["Radios | None"] = None

    def __init__(
        self,
        count: int,
        *,
        seed: int,
        range: float = 10.0,  # noqa: A002 - the word of the field
        exponent: float = 3.0,
        fading: float = 0.0,
        rate: float = 1.0,
        jitter: float = 0.01,
    ) -> None:
        _check("count", count, 1, _MOST_RADIOS)
        _check("seed", seed, 0, 2**63 - 1)
        _check("range", range, 1e-3, 1e6)
        _check("exponent", exponent, 1, 10)
        _check("jitter", jitter, 0, 10)
        if fading:
            _check("fading", fading, 0.5, 100)
        if rate not in _RATES:
            raise InputError(f"rate: {rate!r} found, expected 1, 2, 5.5 or 11 Mbit/s")
        if Radios._open is not None:
            raise InputError(
                "other radios are open, but ns-3 allows one simulation in a process; close() them"
            )
        self.power = _THRESHOLD_DBM + _LOSS_AT_ONE_METRE_DB + 10 * exponent * math.log10(range)
        self._count = count
        self._jitter = float(jitter)
        self._sent: list[tuple[int, bytes, int]] = []
        run, start = divmod(int(seed), _LARGEST_SEED)
        self._radios = _library().Radios(
            count, start + 1, run + 1, _RATES[rate], float(exponent), self.power, float(fading)
        )
        Radios._open = self

    def step(
        self, positions: ArrayLike, messages: Iterable[tuple[int, bytes]], seconds: float
    ) -> list[Delivery]:
        """Advance in time; return the received messages, in the order of their arrival.

        A message that is in transit at the end of a step arrives in a later step.

        Args:
            positions: positions of all radios during this step, metres, (count, 2) or (count, 3).
            messages: index of the sender and payload, at most 2200 bytes each; shorter payloads than 4 bytes
                are sent as 4 bytes. A radio may send several messages.
            seconds: duration of the step, above 0, an integer number of nanoseconds.

        Raises InputError for values outside these ranges, and after `close`.
        """
        if self._radios is None:
            raise InputError("the radios are closed")
        places = np.asarray(positions, dtype=np.float64)
        if places.shape not in {(self._count, 2), (self._count, 3)} or not np.isfinite(places).all():
            raise InputError(
                f"positions: expected ({self._count}, 2) or ({self._count}, 3) finite numbers, "
                f"found the shape {places.shape}"
            )
        _check("seconds", seconds, 1e-9, 1e6)
        for index, position in enumerate(places.tolist()):
            self._radios.move(index, *(position if len(position) == 3 else [*position, 0.0]))
        begin = int(self._radios.now())
        for sender, payload in messages:
            if not 0 <= sender < self._count:
                raise InputError(f"messages: there is no radio {sender!r}, only 0 to {self._count - 1}")
            _check_payload(payload)
            self._radios.send(int(sender), len(self._sent), len(payload), self._jitter)
            self._sent.append((int(sender), payload, begin))
        deliveries = []
        for message in self._radios.run(round(seconds * 1e9)):
            sender, payload, at = self._sent[message.message]
            deliveries.append(Delivery(int(message.receiver), sender, payload, (int(message.at) - at) * 1e-9))
        return deliveries

    def close(self) -> None:
        """End ns-3's simulation, so that other radios can be created."""
        if self._radios is not None:
            self._radios.close()
            self._radios = None
            Radios._open = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _check_payload(payload: object) -> None:
    if not isinstance(payload, bytes) or len(payload) > _LARGEST_MESSAGE:
        raise InputError(f"messages: {payload!r:.80} found, expected at most {_LARGEST_MESSAGE} bytes")


def _check(name: str, value: object, low: float, high: float) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(f"{name}: {value!r} found, expected a number from {low:g} to {high:g}")


@cache
def _library() -> Any:  # noqa: ANN401 - a namespace of C++
    """Load ns-3 and compile the radios, which takes seconds. Raises InputError if it is not installed."""
    try:
        import cppyy
    except ModuleNotFoundError as error:
        raise InputError(f"{error.name} is not installed; pip install 'swarmwright[ns3]'") from error
    spec = find_spec("ns3")
    folders = (
        [Path(location) for location in (spec.submodule_search_locations or ())] if spec is not None else []
    )
    folder = next((path for path in folders if (path / "lib64").is_dir()), None)
    if folder is None:
        raise InputError("ns3 is not installed; pip install 'swarmwright[ns3]'")
    cppyy.add_include_path(str(folder / "include"))
    for name in _LIBRARIES:
        (library,) = (folder / "lib64").glob(f"libns3.*-{name}.so")
        cppyy.load_library(str(library))
    cppyy.cppdef(Path(__file__).with_name("radios.cpp").read_text(encoding="utf-8"))
    return cppyy.gbl.swarmwright_radios
