"""The page of a reduction in a real browser: what it shows, and how it is used."""

import re
import shutil
from functools import cache

import pytest

from gmr_gym.experiments.mixtures import crouse, posterior
from gmr_gym.mixture import moments
from gmr_gym.reduction import reducer
from gmr_gym.reduction.distances import integral_squared_difference
from gmr_gym.replay.reduction import reduction_page

playwright = pytest.importorskip("playwright.sync_api")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no chromium, chromium-browser or google-chrome")


@cache
def line():
    return reduction_page(crouse(), ["runnalls", "west", "ise"], title="ten")


@cache
def dense():
    return reduction_page(posterior(), ["runnalls", "k-means", "capping"], 25)


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


@pytest.fixture
def opened(browser, tmp_path):
    """Opens a page; at the end, nothing was fetched and nothing said on the console."""
    contexts, said, fetched = [], [], []

    def open_page(text, size=(1200, 800), **options):
        file = tmp_path / "page.html"
        file.write_text(text, encoding="utf-8")
        context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
        contexts.append(context)
        tab = context.new_page()
        tab.on("console", lambda message: said.append(message.text))
        tab.on("pageerror", lambda error: said.append(str(error)))
        tab.on("request", lambda request: fetched.append(request.url))
        tab.goto(file.as_uri())
        tab.wait_for_selector("[data-components]")
        return tab

    yield open_page
    for context in contexts:
        context.close()
    assert said == []
    assert {url.split("/")[-1] for url in fetched} == {"page.html"}


def settled(tab, components):
    """Waits until the panels show that number of components, and move no more."""
    tab.wait_for_selector(f"[data-components='{components}'][data-moving='false']")


def words(tab):
    return tab.locator(".gmr-words").all_text_contents()


def slide(tab, step):
    tab.locator(".gmr-time").evaluate(
        f"node => {{ node.value = {step}; node.dispatchEvent(new Event('input')); }}"
    )


def test_keys_go_from_one_number_of_components_to_the_next(opened):
    tab = opened(line())
    settled(tab, 10)
    assert words(tab) == ["10 components, ISE 0"] * 3
    for key, components in (("ArrowRight", 9), ("ArrowRight", 8), ("ArrowLeft", 9), ("End", 1), ("Home", 10)):
        tab.keyboard.press(key)
        settled(tab, components)
    assert tab.locator(".gmr-clock").text_content() == "10 of 10 components"


def test_a_step_is_told_in_words_with_the_errors_of_the_reductions(opened):
    tab = opened(line())
    slide(tab, 4)
    settled(tab, 6)
    for name, said in zip(["runnalls", "west", "ise"], words(tab), strict=True):
        ise = integral_squared_difference(crouse(), reducer(name, 6)(crouse())[0])
        assert re.match(r"6 components, ISE (\S+), B ", said)[1] == f"{ise:.3g}"
    told = tab.locator(".gmr-merges").first.locator("li").all_text_contents()
    assert told[0] == "63 (0.12) and 7+10 (0.12) into one; ISE now 0.00122"
    assert [text[0] for text in told] == ["6", "7", "8"]
    tab.click(".gmr-merges li:nth-child(2) button")
    settled(tab, 7)


def test_it_plays_to_the_last_step_and_stops(opened):
    tab = opened(line())
    tab.select_option("select", "5")
    tab.click("button[aria-label=Play]")
    settled(tab, 1)
    tab.wait_for_selector("button[aria-label=Play]")


def test_pointing_at_a_component_shows_its_numbers_and_a_click_keeps_them(opened):
    tab = opened(line())
    slide(tab, 9)
    settled(tab, 1)
    box = tab.locator(".gmr-stage canvas").first.bounding_box()
    at = box["x"] + box["width"] / 2, box["y"] + box["height"] / 3
    chosen = tab.locator(".gmr-chosen")
    tab.mouse.move(*at)
    tab.wait_for_selector("text=Component 1+2+… (10)")
    mean, covariance = moments(crouse())
    assert f"Weight 1Mean {mean[0]:.3g}Variance {covariance[0, 0]:.3g}" in chosen.text_content()
    assert "component 4" in chosen.text_content()
    tab.mouse.move(0, 0)
    tab.wait_for_selector("text=Point at a component")
    tab.mouse.click(*at)
    tab.mouse.move(0, 0)
    assert "runnalls, 1 of 1" in chosen.text_content()
    tab.keyboard.press("Escape")
    assert "Point at a component" in chosen.text_content()


def test_components_are_selected_by_keys(opened):
    tab = opened(dense())
    for key, name in (("ArrowDown", "Component 1"), ("ArrowDown", "Component 2"), ("ArrowUp", "Component 1")):
        tab.keyboard.press(key)
        assert tab.locator(".gmr-chosen h3").first.inner_text().startswith(f"{name}\n")
    assert len(tab.locator(".gmr-chosen p").nth(1).text_content().split(",")) == 4  # its whole mean
    tab.keyboard.press("ArrowRight")
    assert "Point at a component" in tab.locator(".gmr-chosen").text_content()


def test_clusters_are_formed_anew_and_components_dropped_in_words(opened):
    tab = opened(dense())
    tab.keyboard.press("End")
    settled(tab, 25)
    told = "".join(tab.locator(".gmr-merges").all_text_contents())
    assert "dropped; ISE" in told and "into one; ISE" in told
    assert "capping none" in tab.locator(".gmr-strip-head").nth(1).inner_text()


@pytest.mark.parametrize("text", [line, dense], ids=["densities", "ellipses"])
def test_it_is_dark_where_the_reader_wants_it_and_fits_a_telephone(opened, text):
    tab = opened(text(), size=(360, 700), color_scheme="dark")
    assert tab.evaluate("document.documentElement.scrollWidth") == 360
    dark = tab.evaluate("getComputedStyle(document.querySelector('.gmr')).backgroundColor")
    tab.click("button[aria-label='Light or dark']")
    light = tab.evaluate("getComputedStyle(document.querySelector('.gmr')).backgroundColor")
    assert (dark, light) == ("rgb(20, 23, 26)", "rgb(255, 255, 255)")
    assert tab.locator(".gmr-bar .gmr-time").count() == 1


def test_who_wants_no_motion_sees_none(opened):
    tab = opened(line(), reduced_motion="reduce")
    tab.keyboard.press("ArrowRight")
    settled(tab, 9)
    assert tab.get_attribute("[data-moving]", "data-moving") == "false"


def test_zooming_and_fitting_change_what_a_panel_shows(opened):
    tab = opened(dense())
    picture = "document.querySelector('.gmr-stage canvas').toDataURL()"
    whole = tab.evaluate(picture)
    tab.keyboard.press("+")
    tab.wait_for_function(f"whole => {picture} !== whole", arg=whole)
    tab.keyboard.press("f")
    tab.wait_for_function(f"whole => {picture} === whole", arg=whole)
