"""Pages of recordings read back, by what is written of their format and not by what writes them."""

import base64
import json
import zlib
from html.parser import HTMLParser

import numpy as np


class Elements(HTMLParser):
    """The text of a page by element and class."""

    def __init__(self, page):
        super().__init__()
        self.text, self._open = {}, []
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self._open.append((tag, dict(attributes).get("class")))
        self.text.setdefault(self._open[-1], "")

    def handle_endtag(self, tag):
        while self._open and self._open.pop()[0] != tag:
            pass

    def handle_data(self, data):
        if self._open:
            self.text[self._open[-1]] += data


def data_of(page):
    """What a page tells its player."""
    return json.loads(Elements(page).text["script", "gmr-data"])


def unpacked(entries, blob):
    """Columns by name: integers as they are, all else as floats, nan where missing."""
    raw = zlib.decompress(base64.b64decode(blob))
    columns = {}
    for name, entry in entries.items():
        if "same" in entry:
            columns[name] = columns[entry["same"]]
            continue
        dtype = np.dtype("<" + entry["dtype"])
        assert entry["at"] % dtype.itemsize == 0
        stored = np.frombuffer(raw, dtype, int(np.prod(entry["shape"])), entry["at"]).reshape(entry["shape"])
        if entry["dtype"] == "f4" or (entry["low"], entry["step"]) == (0, 1):
            columns[name] = stored
            continue
        columns[name] = entry["low"] + entry["step"] * stored.astype(float)
        if entry.get("nan"):
            columns[name][stored == np.iinfo(dtype).max] = np.nan
    return columns


def columns_of(page):
    """The columns of a page."""
    data = data_of(page)
    return unpacked(data["columns"], data["blob"])
