"""The papers, a module each: their tables, what they print, their claims and their figures."""
