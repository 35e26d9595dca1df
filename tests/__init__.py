"""Tests, their mutants, and the process whose forks are commands."""

import gc

#: Graphs and syntax trees are millions of small tuples; looking through them again and again took a quarter of a run.
gc.set_threshold(100_000, 50, 100)
