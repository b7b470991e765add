"""Pages of results: what they show is the record's, and names are text in them."""

import shutil
from html.parser import HTMLParser
from io import BytesIO

import pytest
from matplotlib.figure import Figure

from gmr_gym.experiments.drawings import legend_above
from gmr_gym.experiments.pages import figures, page
from gmr_gym.experiments.report import report

VOID = {"meta", "br", "path", "use", "line", "rect", "circle", "stop"}


class Page(HTMLParser):
    """Text of every cell by its tag, and whether all that opens is closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.cells, self.values, self.styles, self.tags = [], [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        found = dict(attributes)
        if tag == "td":
            self.values.append(found["data-value"])
        if "style" in found:
            self.styles.append(found["style"])

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th", "button") and data.strip():
            self.cells.append(data)


def cell(value, low=None, high=None):
    return {"value": value, "low": low, "high": high}


def row(name, **metrics):
    return {"tracker": name, "metrics": metrics}


def test_a_table_shows_every_figure_in_the_unit_of_a_screen():
    read = Page(figures([row("pda", track_loss=cell(0.25, 0.2, 0.4), rmse_own=cell(12.0, 10.0, 20.0))]))
    assert read.open == []
    assert read.cells == ["lost, %", "RMSE own, m", "pda", "25", "12"]
    assert [float(value) for value in read.values] == [0.25, 12.0]


def test_bars_of_a_column_share_a_scale_from_0_to_the_largest_end():
    read = Page(figures([row("a", gospa=cell(10.0, 5.0, 20.0)), row("b", gospa=cell(30.0, 25.0, 40.0))]))
    assert read.styles == [
        "left:12.5%;width:37.5%", "left:25.0%", "left:62.5%;width:37.5%", "left:75.0%",
    ]  # fmt: skip


def test_differences_have_0_in_the_middle():
    read = Page(figures([row("a - b", gospa=cell(-1.0, -2.0, 1.0))], zero=True))
    assert read.styles == ["left:0.0%;width:75.0%", "left:25.0%"]


def test_what_is_not_defined_is_a_dash_without_a_bar():
    read = Page(figures([row("a", rmse_own=cell(None)), row("b", rmse_own=cell(3.0))]))
    assert read.cells[-3:] == ["–", "b", "3"] and read.values == ["", "3.0"] and read.styles == []


@pytest.mark.parametrize("name", ["</script><script>alert(1)</script>", 'a"b', "<b>", "&amp;"])
def test_names_are_text(name):
    text = page(name, [figures([row(name, gospa=cell(1.0, 0.0, 2.0))])], f"gmr-gym evaluate {name}")
    read = Page(text)
    assert read.open == [] and name in read.cells
    assert read.tags.count("script") == 1 and "b" not in read.tags


def test_a_page_fetches_nothing():
    text = page("title", [figures([row("a", gospa=cell(1.0, 0.0, 2.0))])], "gmr-gym evaluate x")
    assert not any(word in text for word in ("http", "src=", "@import", "url("))


def test_a_report_has_every_figure_of_its_record_the_curves_and_the_command():
    scans = {"error_common": [1.0, None, 2.0], "track_loss": [0.0, 0.0, 0.5]}
    metrics = {"track_loss": cell(0.5, 0.1, 0.9), "error_common": cell(7.25, 6.0, 8.0)}
    record = {
        "env": "gmr_gym/TurningTarget-v0", "settings": {"clutter_rate": 20}, "runs": 2, "seed": 3,
        "level": 0.95, "versions": {"numpy": "2.4"}, "notes": ["2 runs: too few"],
        "tables": [
            {"rows": [row("pda", **metrics), row("</b>mht", **metrics)]},
            {"rows": [row("</b>mht - pda", error_common=cell(-1.0, -2.0, 0.5))]},
        ],
        "by_scan": {"pda": scans, "</b>mht": scans}, "parameters": {"pda": {}, "</b>mht": {"components": 5}},
        "command": "gmr-gym evaluate gmr_gym/TurningTarget-v0 --tracker pda",
    }  # fmt: skip
    text = report(record, period=1.0)
    read = Page(text)
    assert read.open == [] and "</b>" not in text
    assert [float(value) for value in read.values] == [0.5, 7.25, 0.5, 7.25, -1.0]
    for said in ("clutter_rate=20", "seed 3", "numpy 2.4", "too few", "components=5", record["command"]):
        assert said in text
    assert read.tags.count("svg") == 1 and text == report(record, period=1.0)


def test_a_dollar_in_the_name_of_a_tracker_is_no_formula():
    drawn = Figure()
    drawn.subplots().plot([0, 1], label="mht:note=$\\nothing$")
    legend_above(drawn)
    drawn.savefig(BytesIO(), format="svg")  # a formula would be refused
    assert drawn.legends[0].get_texts()[0].get_text() == "mht:note=$\\nothing$"


def test_a_phone_shows_figures_beside_long_names(tmp_path):
    playwright = pytest.importorskip("playwright.sync_api")
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        pytest.skip("no chromium, chromium-browser or google-chrome")
    name = "runnalls-30:prune_weight=0.001,prune_density=0.001"
    file = tmp_path / "page.html"
    file.write_text(page("gmr_gym/TurningTarget-v0", [figures([row(name, gospa=cell(1.0, 0.0, 2.0))])], "x"))
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=browser, args=["--no-sandbox", "--disable-gpu"])
        tab = started.new_page(viewport={"width": 360, "height": 700})
        tab.goto(file.as_uri())
        assert tab.evaluate("document.documentElement.scrollWidth") == 360
        assert tab.locator("tbody th").bounding_box()["width"] < 180
        started.close()
