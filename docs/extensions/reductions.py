"""A table of every reduction: what it does, what it keeps of a mixture, which maps it follows, its work."""

from sphinx.util.docutils import SphinxDirective

from gmr_gym.catalogue import REDUCTIONS
from gmr_gym.reduction.properties import PROPERTIES


class Reductions(SphinxDirective):
    """The rows of `PROPERTIES`, beside what `gmr-gym list` says of each."""

    def run(self):
        """The table."""
        lines = ["| name | what it does | keeps | follows | work |", "|---|---|---|---|---|"]
        for name, does in REDUCTIONS.items():
            row = PROPERTIES[name]
            keeps = ", ".join(row.keeps) or "nothing"
            lines.append(f"| `{name}` | {does} | {keeps} | {row.follows} | ${row.work}$ |")
        return self.parse_text_to_nodes("\n".join(lines))


def setup(app):
    """Adds the directive."""
    app.add_directive("reductions", Reductions)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
