"""The commands of the command line, one file for each group: what is typed, checked before anything runs.

A command imports what it needs when it runs: help, lists and a shell's completion wait for nothing. They are
named in `gmr_gym.cli`.
"""
