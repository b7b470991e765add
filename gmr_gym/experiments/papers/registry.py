"""Which papers there are: name and sentence, and where a paper is found once it is asked for.

A paper is a file with a `Paper`, and an entry here or a call of `register_paper`. To list them imports none.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gmr_gym.experiments.tables import Paper

PAPERS: dict[str, str] = {}  # name -> what it is about
_PLACES: dict[str, str] = {}


def register_paper(name: str, about: str, place: str) -> None:
    """Makes a paper known to `list` and `reproduce`.

    Parameters
    ----------
    name : str
        What `reproduce` is asked for.
    about : str
        One sentence, for `list`.
    place : str
        MODULE:NAME, where its `Paper` is; the module is imported when the paper is asked for.
    """
    if name in PAPERS:
        raise ValueError(f"there is a paper {name!r} already; choose another name")
    if not all(place.partition(":")):
        raise ValueError(f"place must be MODULE:NAME, got {place!r}")
    PAPERS[name], _PLACES[name] = about, place


def paper_named(name: str) -> "Paper":
    """The paper of this name.

    Raises
    ------
    ValueError
        Where there is none.
    """
    if name not in PAPERS:
        raise ValueError(f"unknown paper {name!r}; choose one of {', '.join(PAPERS)}")
    module, _, attribute = _PLACES[name].partition(":")
    return getattr(import_module(module), attribute)


for _name, _about in {
    "crouse": "reductions of a mixture compared: Fig. 1, random mixtures, a tracker of three hypotheses",
    "dortenzio": "adaptive reduction of a single target's hypotheses: Tables 1-4, Fig. 1",
    "li": "a radar's converted measurements, models and data association: Figs. 1-4, three regimes, a map",
    "lv": "several targets in clutter fitted as a finite mixture: Figs. 1-9, what the trackers score",
    "maybeck": "an F-16 in clutter, filter banks and hypotheses: Table I, Figs. 3-7",
    "maybeck-zhang": "models in the mixture or in filter banks: both papers' trackers and scenarios",
    "williams15": "four targets that meet and part: trackers of many targets compared, scan by scan",
    "zhang": "models and hypotheses of a manoeuvring target reduced jointly: cases 1 and 2, Figs. 1-2",
}.items():
    register_paper(_name, _about, f"gmr_gym.experiments.papers.{_name.replace('-', '_')}:PAPER")
