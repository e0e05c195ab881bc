"""Episodes that a simulation draws itself, picture by picture: as an animation, a video, a still, a page."""

from swarmwright.display.pictures._files import save
from swarmwright.display.pictures._record import Pictured, PictureRecording, Pictures, record

__all__ = ["PictureRecording", "Pictured", "Pictures", "record", "save"]
