"""A real browser, driven by its own driver: Debian's chromium and chromium-driver."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from selenium.webdriver import Chrome, ChromeOptions
from selenium.webdriver.chrome.service import Service


@contextmanager
def chromium(folder: Path, *switches: str, size: tuple[int, int] = (1280, 900)) -> Iterator[Chrome]:
    """Run a browser without a window; its profile lies in `folder`."""
    programs = [
        next(filter(None, map(shutil.which, names)), None)
        for names in (("chromium", "google-chrome", "chrome"), ("chromedriver",))
    ]
    assert all(programs), "chromium and chromedriver are missing; `make test-python` installs them"
    options = ChromeOptions()
    options.binary_location = str(programs[0])
    width, height = size
    for switch in (
        "headless",
        "no-sandbox",  # which needs rights that a container has not
        "disable-gpu",
        "disable-dev-shm-usage",
        "hide-scrollbars",
        f"window-size={width},{height}",
        f"user-data-dir={folder / 'profile'}",
        *switches,
    ):
        options.add_argument(f"--{switch}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = Chrome(options=options, service=Service(executable_path=str(programs[1])))
    try:
        yield browser
    finally:
        browser.quit()
