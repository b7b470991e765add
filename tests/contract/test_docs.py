"""What the pages say is run: their Python, their commands, their links and the functions they name."""

import inspect
import pkgutil
import re
import shlex
import sys
from importlib.util import find_spec
from itertools import takewhile
from pathlib import Path

import gymnasium
import pytest
from radar_files import given

from gmr_gym.cli import app
from gmr_gym.envs.registry import ENVIRONMENTS, MULTI_TARGET, RECORDED, TRACKING
from gmr_gym.filters.tracker import Report
from gmr_gym.models.multi_target import MultiTargetModel

ROOT = Path(__file__).parents[2]
RESULTS = {*(ROOT / "docs" / "results").glob("*.md")}  # which pages include
PAGES = [ROOT / "README.md", *sorted({*(ROOT / "docs").rglob("*.md")} - RESULTS)]
EQUATIONS = ROOT / "docs" / "reference" / "equations.md"
RUN = (
    "evaluate",
    "sweep",
    "merge",
    "record",
    "track",
    "reduce",
    "list",
    "episodes",
)  # commands that take a second; the rest have tests of their own
LONG = re.compile(r"^(STEPS|EPISODES) = [\d_]+", re.M)  # of training and judging: minutes, for a reader
BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"\n]+)\")?\n(.*?)^```$", re.M | re.S)
NUMBER = re.compile(r"(?<!\w)-?\d+(?:\.\d+)?(?:e-?\d+)?")
TOCTREE = re.compile(r"^```{toctree}\n(.*?)^```$", re.M | re.S)
INCLUDED = re.compile(r"^```{literalinclude} (\S+)\n:language: (\w+)\n:caption: (\S+)\n```$", re.M)
NEEDS = {
    "import PPO": "stable_baselines3",
    "from gmr_gym.stonesoup": "stonesoup",
    "from gmr_gym.offline": "minari",
    "from gmr_gym.envs.dacbench": "dacbench",
}  # to run a page
FENCED = re.compile(r"^```.*?^```$", re.M | re.S)


def named(page):
    return str(page.relative_to(ROOT))


def blocks(page):
    """(language, title, text) of each fenced block, or file that stands there as one."""

    def whole(found):
        text = (page.parent / found[1]).read_text(encoding="utf-8")
        return f'```{found[2]} title="{found[3]}"\n{text}```'

    return BLOCK.findall(INCLUDED.sub(whole, page.read_text(encoding="utf-8")))


def commands(text):
    """Arguments of the lines that call gmr-gym."""
    lines = [shlex.split(line, comments=True) for line in text.splitlines()]
    return [words[1:] for words in lines if words[:1] == ["gmr-gym"] and words[1] in RUN]


def without(words, *options):
    """The words, but for these options and their values."""
    return [word for i, word in enumerate(words) if not {word, words[i - 1]} & {*options}]


def execute(language, title, text, namespace):
    if language == "python":
        text = LONG.sub(r"\1 = 1", text)
        if title:
            Path(title).write_text(text, encoding="utf-8")
            text = f"from {title.removesuffix('.py')} import *"
        exec(compile(text, "<page>", "exec"), namespace)
    elif language == "toml" and "[project.entry-points" in text:
        installed = Path("page-0.dist-info")  # what pip would leave of such a pyproject.toml
        installed.mkdir(exist_ok=True)
        (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: page\nVersion: 0\n")
        section = text.partition("[project.entry-points.")[2].partition("\n\n")[0]
        lines = section.replace('"', "").replace("]", "", 1).splitlines()
        with (installed / "entry_points.txt").open("a") as file:
            file.write("\n".join([f"[{lines[0]}]", *lines[1:], ""]))
    elif language == "sh":
        for words in commands(text):
            if words[0] in ("evaluate", "sweep"):
                words = [*without(words, "--runs", "--jobs"), "--runs", "2", "--jobs", "1"]
            if words[0] == "episodes":
                words = [*without(words, "--episodes"), "--episodes", "2"]
            app(words, standalone_mode=False)


def assert_same_numbers(printed, text):
    """The same words, and numbers alike to a tenth or to 1: another processor rounds otherwise."""
    assert NUMBER.split(printed) == NUMBER.split(text)
    got, wanted = ([float(number) for number in NUMBER.findall(each)] for each in (printed, text))
    assert got == pytest.approx(wanted, rel=0.1, abs=1.0), printed


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=named)
def test_every_block_of_a_page_runs_in_order_and_prints_what_it_says(page, tmp_path, monkeypatch, capsys):
    text = page.read_text(encoding="utf-8")
    for word, module in NEEDS.items():
        if word in text and not find_spec(module):
            pytest.skip(f"needs {module}")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    modules = set(sys.modules)
    namespace, language, printed = {"__name__": "page"}, "", ""
    for block in blocks(page):
        if block[0] == "text" and language == "python":
            assert_same_numbers(printed, block[2])
        language = block[0]
        execute(*block, namespace)
        printed = capsys.readouterr().out
    for name in {title.removesuffix(".py") for _, title, _ in blocks(page)} & set(sys.modules) - modules:
        del sys.modules[name]


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_link_and_image_of_a_page_resolves(page):
    prose = FENCED.sub("", page.read_text(encoding="utf-8"))
    for target in re.findall(r"\]\(\s*([^)\s]+)\s*\)", prose):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{named(page)} points to {target}, which is not there"
        if anchor:
            headings = re.findall(r"^#+ (.+)$", file.read_text(encoding="utf-8"), re.M)
            slugs = [re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings]
            assert anchor in slugs, f"{named(page)} points to {target}, which has no such heading"


def test_every_equation_names_functions_that_are_where_it_says():
    rows = [line for line in EQUATIONS.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    for row in rows:
        entries = re.findall(r"((?:`\w+`, )*`\w+`) in `([\w/]+\.py)`", row)
        assert entries or row == "| where | equation | function |", row
        for names, file in entries:
            text = (ROOT / file).read_text(encoding="utf-8")
            for name in re.findall(r"\w+", names):
                assert re.search(rf"^(?:def|class) {name}\b|^{name}\b.* = ", text, re.M), (
                    f"{file} has no {name}"
                )


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_file_that_a_page_names_is_there(page):
    for file in re.findall(r"`((?:gmr_gym|baselines|agents)/[\w/]+\.py)`", page.read_text(encoding="utf-8")):
        assert (ROOT / file).is_file(), f"{named(page)} names {file}, which is not there"


@pytest.mark.parametrize("author", ["D'Ortenzio", "Zhang", "Maybeck", "Li,", "Lv", "Vo", "Williams"])
def test_the_equations_of_every_paper_have_a_table(author):
    sections = EQUATIONS.read_text(encoding="utf-8").split("\n## ")
    (section,) = [section for section in sections if section.startswith(author)]
    assert "\n| where | equation | function |\n" in section


def table(page, header):
    """The cells of each row under the first header row that begins so."""
    lines = page.read_text(encoding="utf-8").partition(f"\n{header}")[2].splitlines()[2:]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in takewhile(bool, lines)]


def first_column(rows):
    """The names in the first cells, as often as they stand there."""
    return [name for cell, *_ in rows for name in re.findall(r"`(\w+)`", cell)]


@pytest.mark.parametrize(
    ("page", "header", "record"),
    [
        ("without-gym.md", "| field ", Report),
        ("environments/unknown-clutter.md", "| field ", MultiTargetModel),
    ],
)
def test_a_table_of_fields_has_every_field_in_order(page, header, record):
    assert tuple(first_column(table(ROOT / "docs" / page, header))) == record._fields


def page_of(env_id):
    (page,) = [page for page in PAGES if page.read_text(encoding="utf-8").startswith(f"# {env_id}\n")]
    return page


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_an_environment_has_a_page_with_its_arguments_and_its_observations(env_id):
    page, env = page_of(env_id), gymnasium.make(env_id, **given(env_id)).unwrapped
    scenario = (TRACKING | MULTI_TARGET | RECORDED).get(env_id)
    made_of = [type(env), *([pkgutil.resolve_name(scenario)] if scenario else [])]
    takes = [p for part in made_of for p in inspect.signature(part).parameters.values()]
    takes = {p.name for p in takes if p.kind != p.VAR_KEYWORD} - {"scenario"}
    assert sorted(first_column(table(page, "| argument "))) == sorted(takes)
    if isinstance(env.observation_space, gymnasium.spaces.Dict):
        shapes = {f"`{key}`": str(space.shape) for key, space in env.observation_space.items()}
        assert {key: shape for key, shape, *_ in table(page, "| key ")} == shapes


@pytest.mark.parametrize("language", ["python", "sh"])
def test_the_pages_hold_blocks_of_each_language(language):
    assert sum(kind == language for page in PAGES for kind, _, _ in blocks(page)) > 5


def shown_from(page):
    """The page, and all below it in the navigation."""
    listed = TOCTREE.findall(page.read_text(encoding="utf-8"))
    lines = [line for text in listed for line in text.splitlines() if line and not line.startswith(":")]
    names = [line.partition("<")[2].rstrip(">") or line for line in lines]
    return {page}.union(*(shown_from((page.parent / f"{name}.md").resolve()) for name in names))


def test_the_navigation_shows_every_page():
    assert shown_from(ROOT / "docs" / "index.md") == set(PAGES[1:])


def test_every_package_is_a_room_of_the_reference():
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    tops = ("gmr_gym", "gmr_gym/baselines")  # the second is a link
    packages = [path.parent for top in tops for path in (ROOT / top).rglob("__init__.py")]
    rooms = {".".join(package.relative_to(ROOT).parts) for package in packages}
    assert sorted(re.findall(r"^```{room} (\S+)$", text, re.M)) == sorted(rooms)


def test_the_readme_can_be_read_in_one_go():
    assert len(PAGES[0].read_text(encoding="utf-8").splitlines()) <= 90
