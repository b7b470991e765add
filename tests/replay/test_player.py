"""The player in a real browser: what it shows, how it is used, and what it costs."""

import shutil
from collections import defaultdict

import numpy as np
import pytest
from made_tracks import made

from gmr_gym.replay.page import page
from gmr_gym.replay.recording import Recording
from gmr_gym.replay.tracked import recording_of

playwright = pytest.importorskip("playwright.sync_api")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no chromium, chromium-browser or google-chrome")
KEPT, SCANS = 5, 12


def one_target(rng, scans, hypotheses, lost_at=-1, traced=True):
    """Columns of a tracker whose heaviest hypothesis is the truth, updated with detection 2."""
    rows, counts = defaultdict(list), defaultdict(list)
    truth = np.column_stack([10.0 * np.arange(scans), np.zeros(scans)])
    spread = np.tile([4.0, 0.0, 4.0], (hypotheses, 1))
    for t, at in enumerate(truth):
        offsets = np.vstack([[0.0, 0.0], rng.normal(0, 60, (KEPT - 1, 2))])
        into = np.arange(hypotheses) % (2 * KEPT)
        into = np.where(into < KEPT, into, -1)
        set_of = {
            "z": at + np.array([[25.0, 25.0], [-25.0, 25.0], [25.0, -25.0]]),
            "gate": at + offsets, "gate_shape": 25 * spread[:KEPT],
            "kept_w": np.array([0.6, 0.1, 0.1, 0.1, 0.1]), "kept": at + offsets, "kept_P": spread[:KEPT],
            "full_per_kept": np.bincount(into[into >= 0]),
            "full_w": np.full(hypotheses, 1 / hypotheses), "full": at + rng.normal(0, 20, (hypotheses, 2)),
            "full_P": spread, "full_parent": rng.integers(0, KEPT if t else 1, hypotheses),
            "full_detection": np.where(into == 0, 1, -1), "full_into": into,
            "full_mode": np.zeros(hypotheses, int),
        }  # fmt: skip
        for name, values in set_of.items():
            rows[name].append(values)
        for group in ("z", "gate", "kept", "full"):
            counts[group].append(len(set_of[group]))
    columns = {name: np.concatenate(values) for name, values in rows.items()}
    columns |= {f"{group}_start": np.cumsum([0, *lengths]) for group, lengths in counts.items()}
    columns |= {
        "target": np.full(scans, 1),
        "estimate": truth + 1.0, "estimate_P": np.tile([9.0, 0, 9.0], (scans, 1)),
        "error": np.full(scans, 1.4), "count": np.full(scans, KEPT), "alive": np.ones(scans, bool),
        "lost_at": np.array([lost_at]),
    }  # fmt: skip
    if not traced:
        columns = {name: column for name, column in columns.items() if not name.startswith("full")}
    return truth, columns


def recorded(*names, scans=SCANS, hypotheses=40, change=lambda columns: None, **of_tracker):
    """A recording of made-up trackers of one target."""
    columns = {}
    for i in range(len(names)):
        truth, own = one_target(np.random.default_rng(i), scans, hypotheses, **of_tracker)
        columns |= {"truth": truth} | {f"{i}/{key}": column for key, column in own.items()}
    change(columns)
    return Recording("gmr_gym/TurningTarget-v0", 1, "one", 1.0, scans, 5, False, (), names, columns)


def of_many_targets(scans=6):
    """A recording of two targets, of which the second is declared from the third scan on, with label 7."""
    truth = np.stack([[[0.0, 10.0 * t], [50.0, 10.0 * t]] for t in range(scans)])
    truth[:2, 1] = np.nan
    both = [truth[t][np.isfinite(truth[t, :, 0])] for t in range(scans)]
    declared, start = np.concatenate(both), np.cumsum([0, *map(len, both)])
    spread = np.tile([9.0, 0.0, 9.0], (len(declared), 1))
    own = {
        "z": declared, "z_start": start, "origin": np.zeros(len(declared), int),
        "declared": declared, "declared_start": start, "existence": np.ones(len(declared)),
        "label": np.concatenate([[-1, 7][: len(one)] for one in both]),
        "kept_w": np.ones(len(declared)), "kept": declared, "kept_P": spread, "kept_start": start,
        "guess": truth[:, 0], "guess_P": spread[:scans], "guess_start": np.arange(scans + 1),
        "expected": np.diff(start) + 0.25, "gospa": np.ones(scans), "present": np.diff(start),
    }  # fmt: skip
    columns = {"truth": truth} | {f"0/{name}": column for name, column in own.items()}
    return Recording("gmr_gym/UnknownClutter-v0", 1, "many", 1.0, scans, 0, False, (), ("a",), columns)


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


@pytest.fixture
def opened(browser, tmp_path):
    """Opens the page of a recording; at the end, nothing was fetched and nothing said on the console."""
    contexts, said, fetched = [], [], []

    def open_page(recording, size=(1200, 800), **options):
        file = tmp_path / "page.html"
        file.write_text(page(recording), encoding="utf-8")
        context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
        contexts.append(context)
        tab = context.new_page()
        tab.on("console", lambda message: said.append(message.text))
        tab.on("pageerror", lambda error: said.append(str(error)))
        tab.on("request", lambda request: fetched.append(request.url))
        tab.goto(file.as_uri())
        tab.wait_for_selector("[data-scan]")
        return tab

    yield open_page
    for context in contexts:
        context.close()
    assert said == []
    assert {url.split("/")[-1] for url in fetched} == {"page.html"}


def scan_of(tab):
    return int(tab.get_attribute("[data-scan]", "data-scan"))


def scan_of_soon(tab, scan):
    return soon(tab, f"[data-scan='{scan}']", "")


def soon(tab, selector, text):
    """True once the first element of the selector holds the text."""
    test = "([selector, text]) => document.querySelector(selector)?.textContent.includes(text)"
    return bool(tab.wait_for_function(test, arg=[selector, text]))


def middle(tab, dx=0.0):
    """Where the first panel's middle is on the page."""
    box = tab.locator(".gmr-stage canvas").first.bounding_box()
    return box["x"] + box["width"] / 2 + dx, box["y"] + box["height"] / 2


def test_playing_goes_on_and_stops_at_the_last_scan(opened):
    tab = opened(recorded("a"))
    tab.select_option("select[aria-label=Speed]", "40")
    tab.click("button[aria-label=Play]")
    assert scan_of_soon(tab, SCANS)
    tab.wait_for_selector("button[aria-label=Play]")


def test_the_slider_and_a_chart_go_to_a_scan(opened):
    tab = opened(recorded("a"))
    tab.fill("input[aria-label=Scan]", "7")
    assert scan_of_soon(tab, 7) and "scan 7 of 12, 7 s" in tab.inner_text(".gmr-clock")
    box = tab.locator(".gmr-strip canvas").first.bounding_box()
    tab.mouse.click(box["x"] + box["width"] - 9, box["y"] + 20)
    assert scan_of_soon(tab, SCANS)


def test_the_reduction_is_said_in_numbers_and_stage_by_stage(opened):
    tab = opened(recorded("a", "b"))
    assert "40 hypotheses: 20 pruned, 20 merged into 5" in tab.inner_text(".gmr-words >> nth=1")
    tab.fill("input[aria-label='Stage within the scan']", "100")
    assert soon(tab, ".gmr-words", "Predicted: 5 gates, 3 detections")


def test_a_click_tells_the_associations_of_a_hypothesis_and_the_uses_of_a_detection(opened):
    tab = opened(recorded("a"))
    tab.keyboard.press("ArrowRight")
    tab.mouse.click(*middle(tab, dx=6))
    chosen = tab.inner_text(".gmr-chosen")
    assert "Hypothesis 1 of 5" in chosen and "merged from 4 hypotheses" in chosen and "detection 2" in chosen
    tab.click(".gmr-chosen button")  # its parent
    assert scan_of_soon(tab, 1)
    x, y = middle(tab)
    tab.keyboard.press("-")
    tab.keyboard.press("-")
    scale = tab.locator(".gmr-stage canvas").first.bounding_box()["height"]
    for step in range(40, int(scale / 2), 4):  # detection 2 lies up and to the left
        tab.mouse.click(x - step, y - step)
        if "Detection 2 of 3" in tab.inner_text(".gmr-chosen"):
            break
    assert "4 hypotheses, summed weight 0.10" in tab.inner_text(".gmr-chosen")


def test_hypotheses_that_are_too_light_to_be_drawn_are_counted_all_the_same(opened):
    def change(columns):
        columns["0/full_per_kept"] += 3
        columns["0/full_rest_count"], columns["0/full_rest_merged"] = np.full((2, SCANS), [[0], [15]])

    tab = opened(recorded("a", change=change))
    assert "55 hypotheses: 20 pruned, 35 merged into 5" in tab.inner_text(".gmr-words")
    tab.keyboard.press("n")
    assert "merged from 7 hypotheses" in tab.inner_text(".gmr-chosen")


def test_the_help_lists_what_acts_and_components_are_no_hypotheses(opened):
    tab = opened(of_many_targets())
    tab.keyboard.press("?")
    help = tab.inner_text("role=dialog")
    assert "play or pause" in help and "reduction" not in help and "its numbers" in help
    tab.keyboard.press("n")
    assert tab.inner_text(".gmr-chosen h3").startswith("Component 1 of 1")


def test_keys_step_hide_the_truth_select_and_open_the_help(opened):
    tab = opened(recorded("a"))
    for key, scan in (("ArrowRight", 2), ("End", SCANS), ("ArrowLeft", SCANS - 1), ("Home", 1)):
        tab.keyboard.press(key)
        assert scan_of_soon(tab, scan)
    tab.keyboard.press("t")
    assert tab.get_attribute("text=truth >> nth=0", "aria-pressed") == "false"
    tab.keyboard.press("n")
    assert "Hypothesis 1 of 5" in tab.inner_text(".gmr-chosen")
    tab.keyboard.press("?")
    assert tab.is_visible("role=dialog")
    tab.keyboard.press("Escape")
    assert not tab.is_visible("role=dialog") and tab.inner_text(".gmr-chosen") == ""


def test_a_lost_target_a_given_up_one_and_a_missing_estimate_are_said(opened):
    def change(columns):
        columns["1/alive"][3:] = False
        columns["1/estimate"][1] = np.nan
        columns["1/error"][1] = np.nan

    tab = opened(recorded("a", "b", lost_at=2, traced=False, change=change))
    stages = tab.locator(".gmr-over")
    assert stages.nth(0).inner_text().strip() == ""
    tab.fill("input[aria-label=Scan]", "2")
    assert soon(tab, "figure:nth-child(2) .gmr-note", "no estimate at this scan")
    assert "b unknown" in tab.inner_text(".gmr-strip-head")
    tab.fill("input[aria-label=Scan]", "4")
    assert soon(tab, "figure:nth-child(2) .gmr-note", "given up")
    assert "target lost at scan 3" in stages.nth(0).inner_text()


def test_many_targets_are_said_and_charted_against_their_true_number(opened):
    tab = opened(of_many_targets())
    assert "1 target declared, 1.25 expected; 1 component" in tab.inner_text(".gmr-words")
    tab.fill("input[aria-label=Scan]", "4")
    assert soon(tab, ".gmr-words", "2 targets declared, 2.25 expected; 2 components")
    assert "true number 2" in tab.locator(".gmr-strip-head").nth(1).inner_text()


def test_tracks_of_a_file_are_said_with_their_own_times_and_without_a_truth(opened):
    seen = made(seed=1, scans=8, period=2.5)
    tab = opened(recording_of(seen.tracks, seen.detections, seen.scans, title="plots.csv"))
    assert tab.inner_text("header span") == "plots.csv"
    assert "3 tracks, 1.50 expected" in tab.inner_text(".gmr-words")
    tab.fill("input[aria-label=Scan]", "4")
    assert soon(tab, ".gmr-clock", "scan 4 of 8, 7.5 s")
    assert "true" not in tab.inner_text(".gmr-key")
    tab.keyboard.press("t")
    tab.keyboard.press("n")
    tab.get_by_label("Ring the detections that tracks take").click()
    assert tab.get_by_label("Ring the detections that tracks take").get_attribute("aria-pressed") == "true"


def test_a_radar_is_seen_from_where_it_stands(opened):
    tab = opened(recorded("a")._replace(radar=True))
    image = "document.querySelector('canvas').toDataURL()"
    before = tab.evaluate(image)
    tab.select_option("select[aria-label=View]", "radar")
    tab.wait_for_function(f"before => {image} != before", arg=before)


def test_two_players_of_a_page_keep_apart(opened):
    tab = opened(recorded("a"))
    tab.evaluate("""() => {
        const other = document.body.appendChild(document.createElement("div"));
        const data = document.querySelector(".gmr-data").textContent;
        return GmrPlayer.start(other, JSON.parse(data));
    }""")
    tab.locator(".gmr-stage").nth(1).click()
    tab.keyboard.press("ArrowRight")
    assert soon(tab, "div.gmr:last-of-type", "scan 2 of 12")
    assert scan_of(tab) == 1


def test_names_are_text_and_never_markup(opened):
    tab = opened(recorded("<img src=x onerror=alert(1)>", "</script><b>bold</b>"))
    assert tab.locator("figcaption strong").all_inner_texts() == [
        "<img src=x onerror=alert(1)>", "</script><b>bold</b>",
    ]  # fmt: skip
    assert tab.locator("img, figcaption b").count() == 0


def test_dark_where_the_reader_likes_it_or_asks_for_it(opened):
    background = "getComputedStyle(document.querySelector('.gmr')).backgroundColor"
    light = opened(recorded("a"))
    assert light.evaluate(background) == "rgb(255, 255, 255)"
    light.click("button[aria-label='Light or dark']")
    assert light.evaluate(background) == "rgb(20, 23, 26)"
    dark = opened(recorded("a"), color_scheme="dark")
    assert dark.evaluate(background) == "rgb(20, 23, 26)"


@pytest.mark.parametrize("names", ["a", "abcd"])
def test_a_phone_shows_all_of_its_width(opened, names):
    tab = opened(recorded(*names), size=(360, 740), has_touch=True)
    assert tab.evaluate("document.documentElement.scrollWidth") <= 360
    widths = [box["width"] for box in map(lambda canvas: canvas.bounding_box(), tab.locator("canvas").all())]
    assert min(widths) > 300
    assert tab.locator("button[aria-label=Play]").bounding_box()["y"] < 740  # in sight without scrolling


def test_who_asks_for_less_motion_sees_the_scans_and_not_their_stages(opened):
    tab = opened(recorded("a"), reduced_motion="reduce")
    tab.select_option("select[aria-label=Speed]", "2")
    tab.click("button[aria-label=Play]")
    tab.wait_for_function("document.querySelector('[data-scan]').dataset.scan > 1")
    assert tab.input_value("input[aria-label='Stage within the scan']") == "1000"


def test_scrubbing_is_fluent(opened):
    tab = opened(recorded("a", scans=170, hypotheses=300))
    times = tab.evaluate(
        """async () => {
            const slider = document.querySelector("input[aria-label=Scan]"), times = [];
            const frame = () => new Promise(requestAnimationFrame);
            let before = await frame();
            for (let scan = 1; scan <= 170; scan++) {
                slider.value = scan;
                slider.dispatchEvent(new Event("input"));
                const now = await frame();
                times.push(now - before);
                before = now;
            }
            return times;
        }"""
    )
    median, late = np.quantile(times, [0.5, 0.95])
    print(f"ms a frame while scrubbing: median {median:.1f}, 95 % below {late:.1f}")
    assert median < 100
    assert scan_of_soon(tab, 170)
