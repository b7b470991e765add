"""Tables of Markdown, and figures with their units."""

from collections.abc import Sequence

SECONDS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def amount(value: float | None, unit: str) -> str:
    """Of seconds or megabytes, a dash for none."""
    if value is None:
        return "-"
    if unit != "s":
        return f"{value:.3g} {unit}"
    scale, unit = next((pair for pair in SECONDS if value >= pair[0]), SECONDS[-1])
    return f"{value / scale:.3g} {unit}"
