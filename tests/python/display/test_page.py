"""The page is opened from a file in a real browser, and played as a person would."""

import base64
import json
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from selenium.webdriver import ActionChains, Chrome, Keys
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from swarmwright.display import Body, Caption, Recording, Scene, pictures, record
from swarmwright.display.files import save
from swarmwright.display.page import format_page, pack, to_bytes, to_json
from tests.python.display.browser import chromium

CAPTION = Caption("minisim: <best> & {{facts}}", (("controller", "layered, 4-8-1, tanh"), ("seed", "1")))


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with chromium(tmp_path_factory.mktemp("browser")) as running:
        yield running


@pytest.fixture
def opened(browser: Chrome, crossing: Any, tmp_path: Path) -> Chrome:
    crossing.message = "</script><script>document.title = 'stolen'</script>"
    file = tmp_path / "episode.html"
    save(record(crossing), file, caption=CAPTION)
    for name in ("browser", "performance"):
        log(browser, name)  # empties it
    browser.get(file.as_uri())
    return browser


def text(browser: Chrome, name: str) -> str:
    return browser.find_element(By.ID, name).text


def log(browser: Chrome, name: str) -> list[dict[str, Any]]:
    """What was logged since it was asked for last."""
    entries: list[dict[str, Any]] = browser.get_log(name)  # type: ignore[no-untyped-call]
    return entries


def press(browser: Chrome, *keys: str) -> None:
    ActionChains(browser).send_keys(*keys).perform()


def eventually(true: Callable[[], bool], what: str, seconds: float = 10) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline, f"never: {what}"
        time.sleep(0.02)


def pixels(browser: Chrome, canvas: str, color: str) -> list[int]:
    """How many pixels of a canvas have the theme's colour of this name, and their mean column."""
    script = """
        const canvas = document.getElementById(arguments[0]);
        const wanted = theme()(arguments[1]).match(/[0-9a-f]{2}/gi).map((part) => parseInt(part, 16));
        const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        let [count, columns] = [0, 0];
        for (let i = 0; i < data.length; i += 4)
          if (wanted.every((value, channel) => data[i + channel] === value)) {
            count += 1;
            columns += (i / 4) % canvas.width;
          }
        return [count, count ? Math.round(columns / count) : -1];
    """
    found: list[int] = browser.execute_script(script, canvas, color)
    return found


@pytest.mark.slow
def test_the_page_says_what_it_shows_and_asks_no_network(opened: Chrome) -> None:
    assert opened.title == "minisim: <best> & {{facts}}"
    assert opened.find_element(By.TAG_NAME, "h1").text == "minisim: <best> & {{facts}}"
    assert "layered, 4-8-1, tanh" in opened.find_element(By.CLASS_NAME, "facts").text
    assert text(opened, "now") == "step 0 of 12"
    assert text(opened, "fitness") == "−12"
    asked = [json.loads(entry["message"])["message"] for entry in log(opened, "performance")]
    urls = [
        entry["params"]["request"]["url"] for entry in asked if entry["method"] == "Network.requestWillBeSent"
    ]
    assert any(url.startswith("file:") for url in urls)
    assert [url for url in urls if url.startswith(("http", "ws"))] == []
    assert log(opened, "browser") == [], "errors of the script"


def test_it_plays_pauses_and_ends(opened: Chrome) -> None:
    speed = Select(opened.find_element(By.ID, "speed"))
    speed.select_by_value("1")
    button = opened.find_element(By.ID, "play")
    start = pixels(opened, "world", "free")
    button.click()
    assert button.text == "Pause"
    eventually(lambda: int(text(opened, "now").split()[1]) > 3, "it plays")
    button.click()
    assert button.text == "Play"
    paused = text(opened, "now")
    here = pixels(opened, "world", "free")
    assert start[0] > 50
    assert here[1] > start[1] + 50, "the agent moved to the right"
    time.sleep(0.3)
    assert text(opened, "now") == paused
    speed.select_by_value("4")
    button.click()
    eventually(lambda: text(opened, "now") == "step 12 of 12", "it ends")
    eventually(lambda: button.text == "Play", "it stops")
    assert text(opened, "fitness") == "0"
    assert pixels(opened, "world", "free")[0] == 0, "nobody is on the way any more"
    button.click()
    eventually(lambda: "step 12" not in text(opened, "now"), "again from the beginning")


def test_keys_and_buttons_step(opened: Chrome) -> None:
    opened.find_element(By.ID, "on").click()
    opened.find_element(By.ID, "on").click()
    assert text(opened, "now") == "step 2 of 12"
    opened.find_element(By.ID, "back").click()
    assert (text(opened, "now"), text(opened, "fitness")) == ("step 1 of 12", "−11")
    opened.find_element(By.TAG_NAME, "h1").click()
    press(opened, Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    assert text(opened, "now") == "step 3 of 12"
    press(opened, Keys.END)
    assert text(opened, "now") == "step 12 of 12"
    press(opened, Keys.ARROW_RIGHT)
    assert text(opened, "now") == "step 12 of 12"
    press(opened, Keys.ARROW_LEFT)
    assert text(opened, "now") == "step 11 of 12"
    press(opened, Keys.HOME)
    assert text(opened, "now") == "step 0 of 12"
    opened.find_element(By.ID, "last").click()
    press(opened, Keys.ARROW_LEFT)
    assert text(opened, "now") == "step 11 of 12", "keys work while a button has the focus"
    press(opened, "+")
    assert opened.find_element(By.ID, "speed").get_attribute("value") == "2"
    press(opened, "t")
    assert opened.find_element(By.ID, "trail").get_attribute("value") == "100"
    press(opened, "r")
    assert opened.find_element(By.ID, "repeat").is_selected()


def test_scrubber_curve_and_legend_follow_each_other(opened: Chrome) -> None:
    scrub = opened.find_element(By.ID, "scrub")
    scrub.send_keys(Keys.ARROW_RIGHT)
    scrub.send_keys(Keys.ARROW_RIGHT)
    assert text(opened, "now") == "step 2 of 12"
    assert scrub.get_attribute("aria-valuetext") == "step 2 of 12"
    marker = pixels(opened, "curve", "accent")
    curve = opened.find_element(By.ID, "curve")
    ActionChains(opened).move_to_element_with_offset(
        curve, int(curve.size["width"] * 0.3), 0
    ).click().perform()
    step = int(re.findall(r"\d+", text(opened, "now"))[0])
    assert 7 <= step <= 11
    assert scrub.get_attribute("value") == str(step)
    assert text(opened, "fitness") == f"−{12 - step}"
    assert pixels(opened, "curve", "accent")[1] > marker[1] + 20
    legend = text(opened, "legend").split("\n")
    assert legend == ["goal", "1", "defender", "1", "agent, free", "1", "agent, arrived", "0"]
    said = opened.find_element(By.ID, "world").get_attribute("aria-label")
    assert said == f"Step {step} of 12: 1 goal; 1 defender; 1 agent, free"


def test_an_address_opens_at_a_step(opened: Chrome) -> None:
    opened.get(f"{opened.current_url.partition('#')[0]}#step=5")
    eventually(lambda: text(opened, "now") == "step 5 of 12", "the step of the address")
    opened.get(f"{opened.current_url.partition('#')[0]}#step=500")
    eventually(lambda: text(opened, "now") == "step 12 of 12", "the last step")


def test_light_and_dark(opened: Chrome) -> None:
    def paper() -> str:
        return opened.find_element(By.TAG_NAME, "body").value_of_css_property("background-color")

    button = opened.find_element(By.ID, "theme")
    light = paper()
    assert button.text == "Dark"
    button.click()
    assert button.text == "Light"
    assert paper() != light
    assert pixels(opened, "world", "free")[0] > 50, "drawn in the theme's colours"
    button.click()
    assert paper() == light


def test_everything_fits_a_narrow_window(opened: Chrome) -> None:
    opened.set_window_size(420, 800)
    try:
        width: int = opened.execute_script("return document.documentElement.scrollWidth")
        assert width <= opened.get_window_size()["width"]
    finally:
        opened.set_window_size(1280, 900)


def test_odd_episodes_can_be_opened(browser: Chrome, tmp_path: Path) -> None:
    odd = {
        "still": Recording((Scene(1e-3, 1e3, 0, "", ()),), (float("nan"),), 0.0),
        "huge": Recording((Scene(5, 5, 0, "", (Body("x", 1, 1, "", 0),)),) * 2, (1e300, -1e-300), 0.1),
        "coming": Recording(
            (
                Scene(3, 3, 0, "", (Body("agent", 1, 1, "free", 0),), grid=True),
                Scene(
                    3,
                    3,
                    1,
                    "",
                    (Body("agent", 1, 1, "free", 0), Body("agent", 2, 2, "caught", 0.5)),
                    grid=True,
                ),
            ),
            (float("-inf"), 1.0),
            0.1,
        ),
    }
    log(browser, "browser")
    for name, recording in odd.items():
        file = tmp_path / f"{name}.html"
        save(recording, file)
        browser.get(file.as_uri())
        press(browser, Keys.END)
        last = len(recording.scenes) - 1
        assert text(browser, "now") == f"step {last} of {last}"
        assert log(browser, "browser") == [], name


def data_of(document: str) -> dict[str, Any]:
    """The plain values of a page."""
    found = re.search(r'<script type="application/json" id="episode">(.*?)</script>', document, re.DOTALL)
    assert found
    data: dict[str, Any] = json.loads(found[1])
    return data


def unpacked(packed: dict[str, Any]) -> Any:
    """Numbers as the page's script reads them."""
    types = {"f4": "<f4", "i4": "<i4", "u1": "u1", "q1": "u1", "q2": "<u2"}
    raw = np.frombuffer(base64.b64decode(packed["data"]), types[packed["type"]])
    if packed["type"] not in {"q1", "q2"}:
        return raw
    none = 255 if packed["type"] == "q1" else 65535
    values = packed["low"] + raw / (none - 1) * (packed["high"] - packed["low"])
    return np.where(raw == none, np.nan, values)


def test_what_never_moves_is_written_once(crossing: Any) -> None:
    (episode,) = data_of(format_page(record(crossing), caption=Caption()))["episodes"]
    assert episode["bodies"]["looks"] == [
        ["goal", ""],
        ["defender", ""],
        ["agent", "free"],
        ["agent", "arrived"],
    ]
    x, y, look = (episode["bodies"]["series"][name] for name in ("x", "y", "look"))
    assert unpacked(x["base"]).tolist() == [12.5, 8.0, 0.5]
    assert unpacked(x["which"]).tolist() == [2]
    assert unpacked(x["data"]).tolist() == [step + 0.5 for step in range(13)]
    assert unpacked(y["which"]).tolist() == []
    assert "data" not in y
    assert unpacked(look["data"]).tolist() == [2] * 12 + [3]
    assert episode["fitness"] == [-float(12 - step) for step in range(12)] + [0.0]


@given(
    values=arrays(np.float32, (7, 5), elements=st.floats(-1000, 1000, width=32) | st.just(float("nan"))),
    kind=st.sampled_from(["f4", "q1", "q2"]),
)
def test_numbers_survive_packing(values: Any, kind: str) -> None:
    packed = {"more": pack(np.arange(3), "u1"), "values": pack(values.reshape(-1), kind)}
    sent = to_bytes(packed)
    end = 4 + int.from_bytes(sent[:4], "little")
    plain = json.loads(sent[4:end])["values"]
    begin = end + plain.pop("at")
    plain["data"] = base64.b64encode(sent[begin : begin + plain.pop("size")]).decode()
    assert begin % 4 == 0
    assert plain == json.loads(to_json(packed))["values"]
    back = unpacked(plain).reshape(values.shape)
    assert (np.isnan(back) == np.isnan(values)).all()
    finite = values[np.isfinite(values)]
    extent = float(np.ptp(finite)) if len(finite) else 0.0
    exact = {"f4": 0.0, "q1": extent / 508, "q2": extent / 131068}[kind]
    np.testing.assert_allclose(back, values, atol=exact * 1.001 + 1e-4, equal_nan=True)


def test_the_last_numbers_of_the_axes_are_not_cut(browser: Chrome, tmp_path: Path) -> None:
    steps = 1001
    scenes = tuple(Scene(20_000, 5_000, step, "far", (Body("agent", step, 9),)) for step in range(steps))
    save(Recording(scenes, tuple(float(step) for step in range(steps)), 0.1), tmp_path / "far.html")
    browser.get((tmp_path / "far.html").as_uri())
    # What is written is noted: where it ends, and how wide the canvas is.
    script = """
        const canvas = document.getElementById(arguments[0]);
        const [context, ends, starts] = [canvas.getContext('2d'), [], []];
        const write = context.fillText.bind(context);
        context.fillText = (text, x, y) => {
          const width = context.measureText(text).width;
          const left = x - { left: 0, center: 0.5, right: 1 }[context.textAlign] * width;
          starts.push(left);
          ends.push(left + width);
          write(text, x, y);
        };
        player.show();
        delete context.fillText;
        return [Math.min(...starts), canvas.clientWidth - Math.max(...ends), starts.length];
    """
    for canvas in ("curve", "world"):
        before, behind, count = browser.execute_script(script, canvas)
        assert count > 5
        assert before >= 0, canvas
        assert behind >= 1, canvas


def test_bodies_at_the_border_are_seen_whole(browser: Chrome, tmp_path: Path) -> None:
    bodies = {
        "middle": [Body("agent", 2, 2, "free")],
        "border": [Body("agent", 0, 2, "free")],
        "corner": [Body("agent", 4, 4, "free")],
    }
    counts = {}
    for name, there in bodies.items():
        file = tmp_path / f"{name}.html"
        scene = Scene(4, 4, 0, "", tuple(there))
        save(Recording((scene,), (0.0,), 0.1), file)
        browser.get(file.as_uri())
        counts[name] = pixels(browser, "world", "free")[0]
    assert counts["middle"] > 50
    assert min(counts.values()) > 0.9 * counts["middle"], counts


def test_numbers_are_in_the_coordinates_of_the_simulation(browser: Chrome, tmp_path: Path) -> None:
    scene = Scene(3.1, 2.1, 0, "", (Body("agent", 1.55, 1.05),), origin=(-1.55, -1.05))
    save(Recording((scene,), (0.0,), 0.1), tmp_path / "moved.html")
    browser.get((tmp_path / "moved.html").as_uri())
    script = """
        const context = document.getElementById('world').getContext('2d');
        const written = [];
        const write = context.fillText.bind(context);
        context.fillText = (text, x, y) => { written.push([text, x, y]); write(text, x, y); };
        player.show();
        delete context.fillText;
        const world = player.world;
        return [written, world.camera.pixels(1.55, 1.05)];
    """
    written, middle = browser.execute_script(script)
    columns = {text: x for text, x, y in written if y > middle[1] and text != "−1"}
    assert {"−1.5", "−1", "−0.5", "0", "0.5", "1", "1.5"} <= {text for text, _, _ in written}
    zeros = [(x, y) for text, x, y in written if text == "0"]
    # One beside the map at the height of the middle, one below it.
    assert len(zeros) == 2
    assert any(abs(x - middle[0]) < 0.5 for x, _ in zeros)
    assert any(abs(y - middle[1]) < 0.5 for _, y in zeros)
    assert columns["1.5"] > middle[0] > columns["−1.5"]


def test_pictures_stand_in_the_place_of_the_world(browser: Chrome, tmp_path: Path) -> None:
    drawn = [np.full((40, 60, 3), (0, 0, 255) if step < 5 else (255, 0, 0), np.uint8) for step in range(9)]

    class Drawn:
        """Blue for five steps, then red."""

        now, fitness, step_size = 0, 1.0, 0.1

        @property
        def done(self) -> bool:
            return self.now == 8

        def step(self) -> None:
            self.now += 1

    episode: Any = Drawn()
    pictures.save(pictures.record(episode, lambda: drawn[episode.now]), tmp_path / "x.html", caption=CAPTION)
    for name in ("browser", "performance"):
        log(browser, name)
    browser.get((tmp_path / "x.html").as_uri())
    middle = """
        const canvas = document.getElementById('world');
        const at = [canvas.width / 2, canvas.height / 2].map(Math.round);
        return [...canvas.getContext('2d').getImageData(...at, 1, 1).data];
    """

    def shows(color: tuple[int, int, int]) -> bool:
        here = browser.execute_script(middle)
        return all(abs(here[channel] - color[channel]) < 5 for channel in range(3))

    eventually(lambda: shows((0, 0, 254)), "the first picture is there")
    assert not browser.find_element(By.ID, "bodies").is_displayed()
    assert not browser.find_element(By.ID, "trails").is_displayed()
    assert not browser.find_element(By.ID, "trails-key").is_displayed()
    press(browser, Keys.END)
    assert text(browser, "now") == "step 8 of 8"
    eventually(lambda: shows((254, 0, 0)), "the last picture is there")
    errors = [entry for entry in log(browser, "browser") if entry["level"] == "SEVERE"]
    assert errors == [], "of the script, or pictures that the page may not show"
