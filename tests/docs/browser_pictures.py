"""Pictures of every view of the window: those of `docs/how-to/browser.md`, and all of them to look at.

`make ui-pictures` writes those of the documentation, `python -m tests.docs.browser_pictures FOLDER` each
view, light and dark, 1,400 and 360 pixels wide.
"""

import sys
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By

import swarmwright
from tests.python.display.browser import chromium
from tests.python.ui.test_browser import eventually, find, page_text, window

IMAGES = Path("docs") / "images"
WIDE, PHONE = (1400, 1000), (360, 800)
COLORS = 128
"""Of a picture in the documentation: its file is a third of one with all."""
VIEWS = {
    "runs": "#/",
    "run": "#/run/nnga-1",
    "compare": "#/compare?run=nnga-1&run=nnga-2&run=cma_es-1&run=cma_es-2",
    "new": "#/new",
    "draw": "#/draw?mission=collective_transport",
    "jobs": "#/jobs",
    "servers": "#/servers",
}


def make_runs(folder: Path) -> None:
    """Evolve a few small runs of two methods."""
    for method in ("nnga", "cma_es"):
        for seed in (1, 2):
            swarmwright.optimize(
                {
                    "simulation": "arena",
                    "parameters": {"mission": "aggregation", "duration": 30},
                    "controller": {"kind": "evostick"},
                    "method": {"kind": method, "population": 24, "generations": 20},
                    "ranking": {"episodes": 1},
                },
                servers="in-process",
                seed=seed,
                out=folder / f"{method}-{seed}",
            )


def is_shown(browser: Chrome, view: str) -> bool:
    """Return whether a view has all that its picture needs."""
    text = page_text(browser)
    needed: dict[str, Callable[[], object]] = {
        "runs": lambda: "4 runs" in text,
        "run": lambda: browser.find_element(By.CSS_SELECTOR, ".u-over"),
        "compare": lambda: browser.find_element(By.CSS_SELECTOR, ".figure img, .figure svg, table"),
        "new": lambda: "Nothing is wrong" in text,
        "draw": lambda: "Nothing is wrong" in text,
    }
    return bool(needed[view]()) if view in needed else len(text) > 100


def open_view(browser: Chrome, address: str, view: str, *, is_dark: bool = False) -> None:
    """Show a view, and in the page of a run the replay of an evaluation."""
    browser.get(f"{address.partition('#')[0]}{VIEWS[view]}")
    browser.execute_script(
        "localStorage.setItem('swarmwright-theme', arguments[0])", "dark" if is_dark else "light"
    )
    browser.refresh()
    eventually(lambda: is_shown(browser, view), view)
    if view == "run":
        eventually(lambda: click_evaluation(browser), "an evaluation is clicked")
        browser.switch_to.frame(find(browser, "iframe"))
        eventually(lambda: "step" in page_text(browser), "the replay")
        browser.switch_to.default_content()
        browser.execute_script("scrollTo(0, 0)")


def click_evaluation(browser: Chrome) -> bool:
    """Click into the map of a run, which is replaced when its data come."""
    chart = browser.find_element(By.CSS_SELECTOR, ".u-over")
    ActionChains(browser).move_to_element_with_offset(chart, 60, -20).click().perform()
    return True


def photograph(browser: Chrome, height: int | None = None) -> Image.Image:
    """Return a picture of the page: its upper `height` pixels, or all of it."""
    width = browser.get_window_size()["width"]
    tall = browser.execute_script("return document.documentElement.scrollHeight")
    browser.set_window_size(width, (height or min(tall, 6000)) + 150)
    picture = Image.open(BytesIO(browser.get_screenshot_as_png())).convert("RGB")
    return picture.crop((0, 0, picture.width, height)) if height else picture


def save(picture: Image.Image, file: Path) -> None:
    picture.quantize(COLORS, dither=Image.Dither.NONE).save(file, optimize=True)
    print(f"{file}: {picture.width} x {picture.height}, {file.stat().st_size / 1000:.0f} kB")


def main(folder: Path | None) -> None:
    """Make the pictures of the documentation, or of all views into a folder."""
    with TemporaryDirectory() as temporary, chromium(Path(temporary), size=WIDE) as browser:
        runs = Path(temporary) / "runs"
        make_runs(runs)
        with window(runs) as address:
            browser.get(address)
            base = browser.current_url
            if folder is None:
                for view, height in (
                    ("runs", 300),
                    ("run", 1150),
                    ("compare", 912),
                    ("new", 900),
                    ("draw", 860),
                ):
                    browser.set_window_size(*WIDE)
                    open_view(browser, base, view)
                    save(photograph(browser, height), IMAGES / f"ui-{view}.png")
                return
            folder.mkdir(parents=True, exist_ok=True)
            for size, place in ((WIDE, "wide"), (PHONE, "phone")):
                for is_dark in (False, True):
                    for view in VIEWS:
                        browser.set_window_size(*size)
                        open_view(browser, base, view, is_dark=is_dark)
                        save(
                            photograph(browser),
                            folder / f"{view}-{place}-{'dark' if is_dark else 'light'}.png",
                        )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
