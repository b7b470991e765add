"""A recording as one HTML page that needs nothing else: no network, no server, no library."""

import json
from collections.abc import Iterable
from html import escape
from pathlib import Path

from gmr_gym.evaluation.writing import whole
from gmr_gym.replay.packing import pack
from gmr_gym.replay.recording import Recording
from gmr_gym.version import __version__

PLAYER = Path(__file__).with_name("player")
PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
{css}
</style>
</head>
<body>
<div class="gmr-player"></div>
<script type="application/json" class="gmr-data">{data}</script>
<script>
{js}
{name}.start(
  document.querySelector(".gmr-player"),
  JSON.parse(document.querySelector(".gmr-data").textContent)
);
</script>
</body>
</html>
"""


def page(recording: Recording) -> str:
    """The page of a recording.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    str
        HTML: the recording, the player and its style. It loads nothing.
    """
    data = _data(recording)
    title = f"{data['title']}: {f'{recording.environment} seed {recording.seed}'.strip()}"
    return document(title, data, "GmrPlayer", [PLAYER / "player.css"], sorted(PLAYER.glob("*.js")))


def document(title: str, data: dict, name: str, styles: Iterable[Path], parts: Iterable[Path]) -> str:
    """A page that loads nothing.

    Parameters
    ----------
    title : str
    data : dict
        What `start` of the script is given, beside the element to fill.
    name : str
        All that the script defines.
    styles : iterable of Path
        Style sheets.
    parts : iterable of Path
        Parts of the script, one of which has a function `start`.

    Returns
    -------
    str
        HTML.
    """
    css, js = ("\n".join(part.read_text(encoding="utf-8") for part in files) for files in (styles, parts))
    js = f'var {name} = (function () {{\n"use strict";\n\n{js}\nreturn {{ start }};\n}})();'
    # within a script element no text can end it, and no line separator is bare
    text = json.dumps(data, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return PAGE.format(title=escape(title), css=css, data=text, js=js, name=name)


def write_page(recording: Recording, out: Path | str) -> None:
    """Write the page of a recording, whole or not at all.

    Parameters
    ----------
    recording : Recording
    out : Path or str

    Raises
    ------
    OSError
        Naming the file.
    """
    text = page(recording)
    with whole(out) as partial:
        partial.write_text(text, encoding="utf-8")


def _data(recording: Recording) -> dict:
    """What the player is given."""
    fields = recording._asdict()
    entries, blob = pack(fields.pop("columns"))
    names = fields.pop("trackers")
    return {
        "title": ", ".join(names),
        **fields,
        "axes": ["x, m", "y, m"],
        "trackers": [{"name": name} for name in names],
        "versions": {"gmr_gym": __version__},
        "columns": entries,
        "blob": blob,
    }
