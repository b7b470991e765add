"""Hostile input to every public door of the package: what is drawn, what is called, what has to hold."""
