"""The papers, a `Paper` each: tables, quantities, claims and figures. Open `registry.py` first."""
