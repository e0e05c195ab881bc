"""Episodes drawn by the simulation itself: as an animation, a video, a still, or a page."""

from swarmwright.display.pictures._files import save
from swarmwright.display.pictures._record import Pictured, PictureRecording, Pictures, record

__all__ = ["PictureRecording", "Pictured", "Pictures", "record", "save"]
