"""Pages of reductions: their numbers are those of the reductions, and no name can break them."""

import html
from pathlib import Path

import numpy as np
import pytest
from unpacked import Elements, data_of

import gmr_gym.replay
from gmr_gym.evaluation.reductions import steps
from gmr_gym.experiments.mixtures import crouse
from gmr_gym.mixture import mixture
from gmr_gym.reduction import REDUCERS
from gmr_gym.replay.reduction import method_named, reduction_page, show_reduction

HOSTILE = """</script><script>alert(1)</script><!-- "'&amp;\u2028\u2029 ]]> \\u003c é"""
METHODS = "runnalls", "west", "ise", "k-means"


def spatial(n=8, d=4):
    rng = np.random.default_rng(0)
    A = rng.normal(size=(n, d, d))
    P = A @ A.transpose(0, 2, 1) + np.eye(d)
    return mixture(np.full(n, 1 / n), rng.normal(0, 5, (n, d)), (P + P.transpose(0, 2, 1)) / 2)


def close(shown, value):
    np.testing.assert_allclose(np.array(shown, float), np.array(value, float), rtol=5e-9, atol=0)


@pytest.mark.parametrize(("p", "axes"), [(crouse(), [0]), (spatial(), [3, 1])], ids=["one dimension", "four"])
def test_the_numbers_of_a_page_are_those_of_the_reductions(p, axes):
    data = data_of(reduction_page(p, METHODS, 3, axes=(3, 1)))
    assert data["axes"] == axes and [method["name"] for method in data["methods"]] == [*METHODS]
    for method in data["methods"]:
        w, m, P = (method["components"][key] for key in "wmP")
        found = steps(p, REDUCERS[method["name"]], 3)
        assert len(found) == len(method["steps"]) == len(p.w) - 2
        for step, shown in zip(found, method["steps"], strict=True):
            rows, seen = shown["kept"], step.mixture.P[:, axes][:, :, axes]
            close([w[row] for row in rows], step.mixture.w)
            close([m[row] for row in rows], step.mixture.m)
            close([P[row] for row in rows], seen[:, *np.triu_indices(len(axes))])
            close([shown["ise"], shown["cost"]], [step.ise, step.merge_cost])
            assert shown["origin"] == step.origin.tolist()
            assert shown["into"] == (None if step.into is None else step.into.tolist())


def test_what_does_not_change_from_step_to_step_is_there_once():
    (runnalls,) = data_of(reduction_page(crouse(), ["runnalls"]))["methods"]
    assert runnalls["steps"][0]["kept"] == [*range(10)]
    assert len(runnalls["components"]["w"]) == 10 + 9  # each of nine merges makes one


def test_no_title_and_no_method_can_end_the_script():
    methods = {HOSTILE: REDUCERS["west"]}
    text = reduction_page(crouse(), methods, title=HOSTILE)
    assert text.count("</script>") == 2 and "\u2028" not in text.partition("gmr-data")[2].partition("</sc")[0]
    data = data_of(text)
    assert data["title"] == data["methods"][0]["name"] == HOSTILE
    assert Elements(text).text["title", None] == f"{HOSTILE}: {HOSTILE}"


def test_the_same_reduction_has_the_same_bytes_and_loads_nothing():
    text = reduction_page(crouse(), METHODS)
    assert text == reduction_page(crouse(), METHODS)
    for word in ("http:", "https:", "fetch(", "import(", "eval(", "src="):
        assert word not in text.replace("http://www.w3.org/2000/svg", "")


def test_the_page_of_the_guide_has_the_numbers_of_today():
    file = Path(__file__).parents[2] / "docs" / "pages" / "reduction-of-crouse.html"
    kept = data_of(file.read_text(encoding="utf-8"))["methods"]
    today = data_of(reduction_page(crouse(), ["runnalls", "west", "ise"]))["methods"]
    for method, now in zip(kept, today, strict=True):
        assert [step["origin"] for step in method["steps"]] == [step["origin"] for step in now["steps"]]
        ise = [[step["ise"] for step in each["steps"]] for each in (method, now)]
        assert ise[0] == pytest.approx(ise[1], rel=1e-6, abs=1e-15)


def test_progress_counts_every_reduction():
    said = []
    reduction_page(crouse(), ["west", "capping"], 8, progress=lambda *both: said.append(both))
    assert said == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_a_notebook_shows_the_page_and_saves_it(tmp_path):
    shown = show_reduction(crouse(), "runnalls", "west", components=4, title="ten")
    assert shown.page == reduction_page(crouse(), ["runnalls", "west"], 4, title="ten")
    assert html.escape(shown.page) in shown._repr_html_()
    shown.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == shown.page


def test_a_method_has_its_parameters_and_may_be_a_function_of_a_module():
    p = crouse()
    by_name = method_named("adaptive:loss_bound=0.5")(p, 10)
    assert len(by_name[0].w) == len(REDUCERS["adaptive"](p, loss_bound=0.5)[0].w) < 10
    ours = method_named("gmr_gym.reduction.salmond_west:salmond:distance=0.5")(p, 10)
    np.testing.assert_array_equal(ours[1], REDUCERS["salmond"](p, 10, distance=0.5)[1])


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("runnals", "unknown reduction 'runnals'; did you mean 'runnalls'"),
        ("west:distance=1", "reduction 'west' takes no parameter 'distance'; it takes none"),
        ("adaptive:bound=1", "reduction 'adaptive' takes no parameter 'bound'; it takes loss_bound"),
        ("adaptive:loss_bound=2", r"loss_bound must lie in \[0, 1\], got 2"),
        ("adaptive:loss_bound=x", r"loss_bound must lie in \[0, 1\], got 'x'"),
        ("gmr_gym.mixture:moments", "reduction 'gmr_gym.mixture:moments' cannot be made: "),
        ("west:components=3", "names components, which are given for all reductions together"),
        ("no.module:f", "reduction 'no.module:f' is no function that can be imported"),
    ],
)
def test_a_method_that_cannot_be_made_is_refused(spec, message):
    with pytest.raises(ValueError, match=message):
        reduction_page(crouse(), [spec], 9)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((crouse(), []), {}, "methods must be from 1 to 4, got 0"),
        ((crouse(), [*METHODS, "salmond"]), {}, "methods must be from 1 to 4, got 5"),
        ((crouse(), ["west", "west"]), {}, "method 'west' is given twice"),
        ((crouse(), "west", 11), {}, "components must be at most the 10 of the mixture, got 11"),
        ((crouse(), "west", 0), {}, "components must be at least 1, got 0"),
        ((spatial(1), "west"), {}, "the mixture must have from 2 to 200 components, got 1"),
        ((spatial(201, 1), "west"), {}, "the mixture must have from 2 to 200 components, got 201"),
        ((spatial(), "west"), {"axes": (0, 4)}, r"axes must be two different ones of 0 to 3, got \(0, 4\)"),
        ((spatial(), "west"), {"axes": (1, 1)}, "axes must be two different ones of 0 to 3"),
        ((spatial(), "west"), {"axes": 2}, "axes must be two different ones of 0 to 3, got 2"),
        ((crouse()._replace(w=-crouse().w), "west"), {}, "p.w must be finite and non-negative"),
    ],
)  # fmt: skip
def test_what_cannot_be_shown_is_refused(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        gmr_gym.replay.reduction_page(*arguments, **options)
