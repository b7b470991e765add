"""A recording as one HTML page that needs nothing else: no network, no server, no library."""

import json
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
GmrPlayer.start(
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
    css = (PLAYER / "player.css").read_text(encoding="utf-8")
    # within a script element no text can end it, and no line separator is bare
    text = json.dumps(data, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    seed = "" if recording.seed is None else f" seed {recording.seed}"
    title = f"{data['title']}: {recording.environment}{seed}"
    return PAGE.format(title=escape(title), css=css, data=text, js=_script())


def _script() -> str:
    """The parts of the player as one script, which defines GmrPlayer and nothing else."""
    parts = "\n".join(part.read_text(encoding="utf-8") for part in sorted(PLAYER.glob("*.js")))
    return f'var GmrPlayer = (function () {{\n"use strict";\n\n{parts}\nreturn {{ start }};\n}})();'


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
