"""A sound server that makes genomes of samples and says which start it is; ones that break its rules."""

from typing import Any, ClassVar

import msgpack
import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from tests.conformance.broken.base import OFFLOADED, Broken
from tests.conformance.sound import Invalid, Json, SoundServer, text
from tests.protocol import samples


class Sampling(SoundServer):
    """Sound. What others break are methods of one purpose each."""

    instance = "a1"

    def capabilities(self) -> Json:
        found = super().capabilities()
        found["swarmwright"] |= {"distributions": ["normal"], "instance": self.announced()}
        return found

    def announced(self) -> Any:
        return self.instance

    def requested(self, payload: bytes) -> None:
        try:
            request = msgpack.unpackb(payload)
        except ValueError:
            request = None
        if isinstance(request, dict) and not self.is_meant(request):
            if self.state == "free":
                self.reply(request, error={"kind": "taken", "reason": "another server is meant"})
            return
        super().requested(payload)

    def is_meant(self, request: Json) -> bool:
        return bool(request.get("instance", self.instance) == self.instance)

    def check(self, request: Json) -> None:
        sample = request.get("sample")
        if sample is not None:
            if request["genomes"]:
                raise Invalid("genomes and sample")
            request["genomes"] = self.made(sample, _engine.genome_size(request["controller"])).tobytes()
        super().check(request)

    def made(self, sample: Json, size: int) -> NDArray[np.float32]:
        rows = [np.frombuffer(sample[name], "<f8") for name in samples.ROWS]
        if text(sample["distribution"]) != "normal" or any(len(row) != size for row in rows):
            raise Invalid("distribution, or the number of weights")
        if not np.isfinite(rows).all() or np.abs(rows[-2:]).max() > np.finfo(np.float32).max:
            raise Invalid("a number")
        if sample["first"] + sample["count"] >= 2**64 or sample["count"] * size * 4 > 64 << 20:
            raise Invalid("first or count")
        return samples.genomes(sample)


class MirrorsNothing(Sampling, Broken):
    """Gives each candidate a direction of its own."""

    breaks: ClassVar = {"S9.1"}
    rules: ClassVar = OFFLOADED

    def made(self, sample: Json, size: int) -> NDArray[np.float32]:
        return super().made({**sample, "mirrored": False}, size)


class TakesAnyDistribution(Sampling, Broken):
    """Takes every distribution for a normal one."""

    breaks: ClassVar = {"S9.11"}
    rules: ClassVar = OFFLOADED

    def made(self, sample: Json, size: int) -> NDArray[np.float32]:
        return super().made({**sample, "distribution": "normal"}, size)


class IsEveryInstance(Sampling, Broken):
    """Serves requests that are meant for another start of it."""

    breaks: ClassVar = {"S9.9"}
    rules: ClassVar = OFFLOADED

    def is_meant(self, request: Json) -> bool:
        return bool(request)


class NumbersItsStarts(Sampling, Broken):
    """Announces a number as its instance."""

    breaks: ClassVar = {"S7.1"}
    rules: ClassVar = "S1,S7"

    def announced(self) -> Any:
        return 7


class PutsAGroupOnTwoSides(Sampling, Broken):
    """Announces two sides of a match with the same agents."""

    breaks: ClassVar = {"S7.1"}
    rules: ClassVar = "S1,S7"

    def capabilities(self) -> Json:
        capabilities = super().capabilities()
        sides = [{"name": name, "groups": ["robots"]} for name in ("left", "right")]
        capabilities["swarmwright"]["sides"] = sides
        return capabilities
