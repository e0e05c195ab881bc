"""Enki, which is Debian's and fits Debian's version of Python alone."""

import sysconfig
from pathlib import Path

import pytest

ENKI = Path(f"/usr/lib/python3/dist-packages/pyenki{sysconfig.get_config_var('EXT_SUFFIX')}")
WHY_NOT = "python3-enki2 is not installed, or Debian's Python is another version than this one"
needs_enki = pytest.mark.skipif(not ENKI.is_file(), reason=WHY_NOT)
