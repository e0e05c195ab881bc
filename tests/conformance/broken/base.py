"""What servers that break a rule have in common."""

from typing import Any, ClassVar

from tests.conformance.sound import SoundServer

STEPWISE = "S1,S2,S3,S4,S5,S6,S7,S8,-S6.5,-S6.9,-S6.13"
"""What is tried on those that break what every server must do, but for what takes seconds."""
OFFLOADED = "S1,S2,S3,S9"
CONNECTION = "S1,S2,S11,-S11.2"
SCENES = "S1,S2,S14"
OWN_TOPIC = "S1,S2,S15"


class Broken(SoundServer):
    """breaks: ids. rules: what is tried, with which parameters. died: whether it is gone afterwards."""

    breaks: ClassVar[set[str]]
    rules: ClassVar[str] = STEPWISE
    died: ClassVar[bool] = False
    parameters_of_episodes: ClassVar[dict[str, Any]] = {}
