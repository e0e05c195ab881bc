"""Episodes that a simulation draws itself, picture by picture: as an animation, a film, a still, a page."""

from swarmwright.display.pictures._files import save
from swarmwright.display.pictures._record import Pictured, PictureRecording, record

__all__ = ["PictureRecording", "Pictured", "record", "save"]
