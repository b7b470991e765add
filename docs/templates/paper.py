"""A row of D'Ortenzio's Table 1 as printed, beside PDA, and whether merging to five hypotheses loses less
than merging to one."""

from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.summary import not_lost
from gmr_gym.experiments.claims import Asked, Claim
from gmr_gym.experiments.drawings import save
from gmr_gym.experiments.tables import Paper, Table

TABLE = Table(
    "1",
    "150 false alarms a scan",
    "gmr_gym/TurningTarget-v0",
    settings={"clutter_rate": 150},
    trackers={"runnalls-5": {}, "pda": {}},
    published={"runnalls-5": {"track_loss": 0.032, "components": 4.9596}},  # of PDA it prints nothing
    runs=1000,
)


def kept_more(weight, five, one):
    """How much greater the share of runs is that five hypotheses keep; weight (runs,) is how often each run
    counts."""
    return float(weight @ (five.kept.astype(float) - one.kept) / weight.sum())


def figures(table, scenario, results, rows, out):
    """Leaves the plots of a table in the folder `out`: here a bar for each tracker's lost runs."""
    drawing = Drawing(layout="constrained")
    axes = drawing.subplots()
    axes.bar([*rows], [100 * row["track_loss"].value for row in rows.values()])
    axes.set(ylabel="runs lost, %")
    save(drawing, out / f"figure-{table.name}.png")


PAPER = Paper(
    (TABLE,),
    figures,
    quantities={"kept": not_lost},
    claims=(
        Asked((Claim("five lose less than one", "share", 0.0, kept_more, "runnalls-5", "pda"),), ("1",)),
    ),
)

if __name__ == "__main__":
    from pathlib import Path

    from gmr_gym.cli import main
    from gmr_gym.experiments.papers.registry import register_paper

    register_paper("five-or-one", "how many hypotheses a track needs", f"{Path(__file__).stem}:PAPER")
    main()
