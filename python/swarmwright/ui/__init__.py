"""The window in the browser: all runs below a folder, live, wherever they were started.

`swarmwright ui` starts it. It reads the stores of runs, so that runs need not know of it, and uses the public
interface of the library alone. It needs `pip install 'swarmwright[ui]'`.
"""

from swarmwright.ui.notebook import NotebookWindow, show

__all__ = ["NotebookWindow", "show"]
