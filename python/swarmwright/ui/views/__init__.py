"""The views of the window: pages, and tabs on the page of a run.

Packages add theirs as entry points of the group `swarmwright.views`, each a `View`.
"""

from swarmwright.ui.views._base import View
from swarmwright.ui.views._registry import load_views

__all__ = ["View", "load_views"]
