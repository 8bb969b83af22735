"""The page in headless Chromium: clicks, keys and sliders as a user's."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_models import coupled
from small_runs import write_run
from waiting import LONG, wait

from dntorch import DNF, Gauss, Global, view

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
pytestmark = pytest.mark.skipif(
    CHROMIUM is None or find_spec("playwright") is None or find_spec("bokeh") is None,
    reason="needs Chromium, playwright and bokeh: apt-get install chromium; pip install "
    "'dntorch[view,test]'",
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def opened(browser: Any, target: Any) -> Iterator[tuple[Any, Any]]:
    """The page of a target in a browser, and its session."""
    served = view(target, browser=False)
    tab = browser.new_page(viewport={"width": 1600, "height": 1000})
    tab.set_default_timeout(1000 * LONG)
    errors: list[str] = []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    try:
        tab.goto(served.url)
        tab.wait_for_selector("canvas")
        yield tab, served.session
        assert not errors
    finally:
        tab.close()
        served.stop()


def canvas(tab: Any, title: str) -> Any:
    return tab.locator(f"canvas[data-title='{title}']")


def picture(tab: Any, title: str) -> str:
    return canvas(tab, title).evaluate("(canvas) => canvas.toDataURL()")


def click_site(tab: Any, title: str, x: float, y: float) -> None:
    """Click into a figure, at parts of its width and height."""
    wide, high = canvas(tab, title).evaluate("(canvas) => [canvas.wide, canvas.high]")
    canvas(tab, title).click(position={"x": 34 + x * wide, "y": 20 + y * high})


def drag(tab: Any, knob: str, part: float) -> None:
    """Move a slider to a part of its range."""
    track = tab.locator(f".knob-{knob} .noUi-base").bounding_box()
    handle = tab.locator(f".knob-{knob} .noUi-handle").bounding_box()
    y = handle["y"] + handle["height"] / 2
    tab.mouse.move(handle["x"] + handle["width"] / 2, y)
    tab.mouse.down()
    tab.mouse.move(track["x"] + part * track["width"], y, steps=5)
    tab.mouse.up()


def reading(tab: Any, knob: str) -> float:
    """What a slider says."""
    return float(tab.locator(f".knob-{knob} .noUi-handle").get_attribute("aria-valuetext"))


def test_play_pause_step_and_reset(browser) -> None:
    with opened(browser, coupled()) as (tab, session):
        before = picture(tab, "space")
        tab.locator(".play button").click()
        assert wait(lambda: session.steps > 20)
        tab.wait_for_function("document.querySelector('#status').textContent[0] > '0'")
        assert picture(tab, "space") != before
        tab.locator(".play button", has_text="pause").click()
        assert wait(lambda: not session.playing)
        steps = session.steps
        tab.locator(".step button").click()
        assert wait(lambda: session.steps == steps + 1)
        tab.keyboard.press(".")
        assert wait(lambda: session.steps == steps + 2)
        tab.locator(".reset button").click()
        assert wait(lambda: session.steps == 0)
        tab.wait_for_function("document.querySelector('#status').textContent.startsWith('0.000')")
        tab.keyboard.press(" ")
        assert wait(lambda: session.playing)


def test_a_slider_sets_a_parameter(browser) -> None:
    with opened(browser, DNF(51)) as (tab, session):
        field = session.source.structure
        drag(tab, "h", 0.25)
        assert wait(lambda: field.h < -8)
        drag(tab, "Gauss-1-amplitude", 0.9)
        assert wait(lambda: field.kernel[0].amplitude > 40)
        session.set("field", "steepness", 8.0)  # from Python: the slider follows
        assert wait(lambda: reading(tab, "steepness") == 8)


def test_a_refused_value_shows_its_sentence_and_goes_back(browser) -> None:
    with opened(browser, DNF(51)) as (tab, session):
        drag(tab, "tau", 0.02)
        sentence = tab.locator(".message").get_by_text("an explicit step would overshoot")
        sentence.wait_for()
        tau = session.source.structure.tau
        assert tau >= 1 / 32
        assert wait(lambda: abs(reading(tab, "tau") - tau) < 0.006)  # it shows two digits
        tab.locator(".step button").click()  # what is done next takes the sentence away
        sentence.wait_for(state="detached")


def test_a_click_puts_an_input_there(browser) -> None:
    with opened(browser, DNF((20, 40))) as (tab, session):
        click_site(tab, "field: activation", 0.75, 0.25)
        assert wait(lambda: len(session.peaks) == 1)
        tab.locator(".step button").click()
        assert wait(lambda: session.steps == 1)
        seen = session.pictures()["field"].input
        assert (
            np.abs(np.subtract(np.unravel_index(seen.argmax(), seen.shape), (4.5, 29.5))).max() < 2
        )
        drag(tab, "position-x", 0.1)
        assert wait(lambda: session.get("input 1 (field)", "position x") < 8)
        tab.locator(".clear button").click()
        assert wait(lambda: not session.peaks)
        assert wait(lambda: tab.locator(".knob-position-x").count() == 0)


def test_what_is_shown_is_chosen(browser) -> None:
    with opened(browser, coupled()) as (tab, session):
        tab.locator(".shown input").click()
        tab.locator(".shown .choices__item--choice", has_text="sum").click()
        assert wait(lambda: session.shown[-1] == "sum")
        canvas(tab, "sum").wait_for()
        tab.locator(".group select").select_option("scene -> space")
        tab.locator(".knob-Gauss-1-sigma").wait_for()
        tab.locator(".speed select").select_option("1/4")
        assert wait(lambda: session.speed == 0.25)


def test_two_pages_show_the_same(browser) -> None:
    with opened(browser, DNF(51)) as (tab, _):
        other = browser.new_page()
        other.goto(tab.url)
        other.wait_for_selector("canvas")
        click_site(tab, "field", 0.5, 0.5)
        other.locator(".knob-position").wait_for()
        other.locator(".play button").click()
        tab.locator(".play button", has_text="pause").wait_for()
        other.close()


def test_the_reward_key_teaches(browser, tmp_path: Path) -> None:
    with opened(browser, write_run(tmp_path)) as (tab, session):
        weights = session.source.agent.weights
        session.set("learning", "exploration", 5.0)
        session.step(400)
        before, shown = weights.clone(), picture(tab, "values (state by action)")
        tab.keyboard.press("r")
        assert wait(lambda: session.source.given == 1)
        session.set_speed(16)
        tab.locator(".play button").click()
        assert wait(lambda: float((weights - before).abs().max()) > 0.01)
        assert wait(lambda: picture(tab, "values (state by action)") != shown)
        tab.locator(".reward button").click()
        assert wait(lambda: session.source.given == 2)


def test_pictures_per_second(browser) -> None:
    """At least 15 of a field of 100 x 100, in the best of some seconds of a busy machine."""
    field = DNF((100, 100), (Gauss(12.0, 3.0), Global(-0.02)))
    with opened(browser, field) as (tab, session):
        session.touch("field", [30, 60])
        session.play()

        def drawn_in_a_second() -> float:
            return tab.evaluate(
                """async () => {
                  const before = dntorch.pictures, begin = performance.now()
                  await new Promise((done) => setTimeout(done, 1000))
                  return 1000 * (dntorch.pictures - before) / (performance.now() - begin)
                }"""
            )

        assert wait(lambda: drawn_in_a_second() >= 15)
