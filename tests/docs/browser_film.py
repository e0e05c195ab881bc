"""The film of the README: from an empty folder to a swarm that does a drawn mission (`make ui-film`).

A real Chromium is driven; between actions its window is photographed. Waiting for servers is left out: a film
shows how something is done, the figures in the documentation say how long it takes.
"""

import re
import sys
import time
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image, ImageDraw, ImageFont
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import Select

from tests.python.display.browser import chromium
from tests.python.ui.test_browser import eventually, find, page_text, window

FILE = Path("docs") / "images" / "ui-film.webp"
SIZE = (1280, 800)
SHOWN_PX = 896
FRAME_MS = 200
CAPTION_PX = 30
QUALITY = 30
LARGEST_BYTES = 4_000_000
GENERATIONS = 1000
"""More than the film shows: the run goes on until the end."""
EPISODES = 2
"""Of a candidate: fewer than the template has, for quick generations."""
CURVE_FRAMES = 25
LONGEST_SCENE_S = 600.0


@dataclass
class Film:
    """Frames of a browser, with a pointer and a caption.

    Args:
        browser: whose window is photographed.
    """

    browser: Chrome
    frames: list[Image.Image] = field(default_factory=list)
    caption: str = ""
    pointer: tuple[float, float] = (SIZE[0] / 2, SIZE[1] / 2)
    is_waiting: bool = False

    def shoot(self, frames: int = 1) -> None:
        """Take pictures of the window as it is."""
        for _ in range(frames):
            picture = Image.open(BytesIO(self.browser.get_screenshot_as_png())).convert("RGB")
            scale = SHOWN_PX / picture.width
            height = round(picture.height * scale)
            frame = Image.new("RGB", (SHOWN_PX, height + CAPTION_PX), "#ffffff")
            frame.paste(picture.resize((SHOWN_PX, height), Image.Resampling.LANCZOS), (0, CAPTION_PX))
            draw = ImageDraw.Draw(frame)
            draw.rectangle((0, 0, SHOWN_PX, CAPTION_PX - 1), fill="#222222")
            draw.text((12, 6), self.caption, fill="#ffffff", font=ImageFont.load_default(16))
            x, y = self.pointer[0] * scale, self.pointer[1] * scale + CAPTION_PX
            arrow = [(0, 0), (0, 17), (4, 13), (7, 19), (10, 18), (7, 12), (12, 12)]
            draw.polygon([(x + dx, y + dy) for dx, dy in arrow], fill="#222222", outline="#ffffff")
            self.frames.append(frame)

    def go(self, element: WebElement, offset: tuple[float, float] = (0, 0)) -> None:
        """Move the pointer to an element, or to a point beside its middle."""
        self.browser.execute_script(
            "const {top, bottom} = arguments[0].getBoundingClientRect();"
            "if (top < 70 || bottom > innerHeight) arguments[0].scrollIntoView({block: 'center'})",
            element,
        )
        box = self.browser.execute_script(
            "const box = arguments[0].getBoundingClientRect();"
            "return [box.x + box.width / 2, box.y + box.height / 2]",
            element,
        )
        x, y = box[0] + offset[0], box[1] + offset[1]
        before = self.pointer
        for share in (0.5, 1.0):
            self.pointer = (before[0] + share * (x - before[0]), before[1] + share * (y - before[1]))
            self.shoot()

    def click(self, element: WebElement) -> None:
        """Move to an element and click it."""
        self.go(element)
        element.click()
        self.shoot()

    def save(self, file: Path) -> None:
        """Write the frames; each that equals the one before makes that one longer."""
        kept: list[Image.Image] = []
        durations: list[int] = []
        for frame in self.frames:
            if kept and frame.tobytes() == kept[-1].tobytes():
                durations[-1] += FRAME_MS
            else:
                kept.append(frame)
                durations.append(FRAME_MS)
        kept[0].save(
            file, save_all=True, append_images=kept[1:], duration=durations, loop=0, quality=QUALITY, method=6
        )
        print(
            f"{file}: {sum(durations) / 1000:.0f} s, {len(kept)} pictures, {file.stat().st_size / 1e6:.1f} MB"
        )


def button(browser: Chrome, label: str) -> WebElement:
    return eventually(lambda: browser.find_element(By.XPATH, f"//button[text()='{label}']"), label)


def draw_mission(film: Film) -> None:
    """Draw two spots and a wall between them, and say what the swarm is for."""
    browser = film.browser
    film.caption = "1  Draw a mission on the arena"
    film.click(find(browser, "header a[href='#/draw']"))
    eventually(lambda: "Nothing is wrong" in page_text(browser), "the board is open")
    Select(find(browser, "[aria-label=Mission]")).select_by_value("dispersion")
    eventually(lambda: "Dispersion" in (find(browser, "textarea").get_attribute("value") or ""), "its text")
    film.shoot(3)
    board = find(browser, ".board")
    for tool, at in (("circle", (110, -100)), ("obstacle", (-20, 60)), ("light", (170, -170))):
        film.click(button(browser, tool))
        film.go(board, at)
        ActionChains(browser).move_to_element_with_offset(board, *map(int, at)).click().perform()
        film.shoot(2)
    reach = browser.execute_script("return arguments[0].clientWidth", board)
    film.shoot()
    ActionChains(browser).move_to_element_with_offset(board, 110, -100).click_and_hold().perform()
    for _ in range(4):
        ActionChains(browser).move_by_offset(round(reach / 60), 0).perform()
        film.pointer = (film.pointer[0], film.pointer[1])
        film.shoot()
    ActionChains(browser).release().perform()
    film.shoot(2)
    film.caption = "2  Say what counts: robots on the spot"
    adding = find(browser, "[data-key='metrics.add']")
    film.go(adding)
    Select(adding).select_by_value("robots_on")
    film.shoot(3)
    entry = eventually(lambda: browser.find_element(By.CSS_SELECTOR, "[data-key=fitness]"), "the fitness")
    film.click(entry)
    entry.send_keys(Keys.CONTROL, "a")
    entry.send_keys("robots_on", Keys.TAB)
    eventually(
        lambda: "fitness: robots_on" in (find(browser, "textarea").get_attribute("value") or ""), "fitness"
    )
    eventually(lambda: "Nothing is wrong" in page_text(browser), "it is right")
    film.shoot(3)


def try_and_save(film: Film) -> None:
    browser = film.browser
    film.caption = "3  Try: a random controller, and the value as it moves"
    film.click(button(browser, "Try"))
    eventually(lambda: find(browser, "output[data-metric=robots_on]").text != "", "its value is shown")
    play(browser)
    film.shoot(20)
    film.caption = "4  Save it, and evolve on it"
    file = find(browser, "[aria-label='Name of the file']")
    film.go(file)
    file.clear()
    file.send_keys("gather")
    film.click(button(browser, "Save"))
    film.click(find(browser, "a[href^='#/new?mission=']"))
    eventually(
        lambda: "gather.yaml" in (find(browser, "textarea").get_attribute("value") or ""), "the experiment"
    )
    lengthen(browser)
    eventually(lambda: "Nothing is wrong" in page_text(browser), "the experiment is right")
    film.shoot(4)
    film.click(find(browser, "button[type=submit]"))


def lengthen(browser: Chrome) -> None:
    """Let the run go on longer than the film, in generations that are shorter than those of the template."""
    editor = find(browser, "textarea")
    text = editor.get_attribute("value") or ""
    text = re.sub(r"generations: \d+", f"generations: {GENERATIONS}", text)
    text = re.sub(r"episodes: \d+", f"episodes: {EPISODES}", text)
    browser.execute_script(
        "arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('input'))", editor, text
    )


def watch(film: Film) -> None:
    """Show the curve while it grows, a frame for each new generation; then a late candidate."""
    browser = film.browser
    film.caption = "5  Watch it evolve, live"
    eventually(lambda: browser.find_element(By.CSS_SELECTOR, ".job .state"), "the job is listed")
    film.shoot(3)
    film.click(find(browser, "header .brand"))
    film.click(eventually(lambda: browser.find_element(By.CSS_SELECTOR, "tbody a"), "the run is listed"))
    find(browser, ".u-over")
    end = time.monotonic() + LONGEST_SCENE_S
    before = ""
    shot = 0
    while shot < CURVE_FRAMES and time.monotonic() < end:
        facts = str(browser.execute_script("return document.querySelector('.facts')?.textContent ?? ''"))
        generation = facts.partition("evaluations")[0]
        if generation != before:
            film.shoot()
            shot += 1
            before = generation
        time.sleep(0.2)
    film.shoot(2)
    film.caption = "6  Click an evaluation: the swarm, replayed"
    chart = find(browser, ".u-over")
    width = chart.size["width"]
    film.go(chart, (width * 0.47, -60))
    ActionChains(browser).move_to_element_with_offset(chart, int(width * 0.47), -60).click().perform()
    frame = eventually(lambda: browser.find_element(By.TAG_NAME, "iframe"), "the replay")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", frame)
    play(browser, speed=4)
    film.shoot(35)


def stop(browser: Chrome) -> None:
    """Stop the run, which would go on without the window."""
    find(browser, "header a[href='#/jobs']").click()
    find(browser, ".job, .empty")
    for running in browser.find_elements(By.XPATH, "//button[text()='Stop']"):
        running.click()
        eventually(lambda: find(browser, ".job .state").text == "stopped", "the run is stopped")


def play(browser: Chrome, speed: float = 2) -> None:
    """Let the replay on the page play, if it does not yet."""
    browser.switch_to.frame(find(browser, "iframe"))
    start = eventually(lambda: browser.find_element(By.ID, "play"), "the player")
    eventually(lambda: "step" in browser.find_element(By.ID, "now").text, "the episode is shown")
    browser.execute_script("document.getElementById('speed').value = arguments[0]", str(speed))
    if start.text == "Play":
        start.click()
    browser.switch_to.default_content()


def main(file: Path = FILE) -> None:
    """Make the film."""
    with TemporaryDirectory() as temporary, chromium(Path(temporary), size=SIZE) as browser:
        runs = Path(temporary) / "runs"
        runs.mkdir()
        with window(runs) as address:
            browser.get(address)
            eventually(lambda: "no runs below" in page_text(browser), "the folder is empty")
            film = Film(browser, caption="An empty folder:  swarmwright ui runs")
            film.shoot(6)
            try:
                for scene in (draw_mission, try_and_save, watch):
                    scene(film)
            finally:
                film.save(file)
                stop(browser)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
