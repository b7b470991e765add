"""The papers, a `Paper` each: tables, quantities, claims and figures. Open `registry.py` first; what a paper
prints is in a CSV file of its name."""
