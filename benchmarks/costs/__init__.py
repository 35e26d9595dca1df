"""What ``benchmarks/cost.py`` measures: one module a kind of subject, one that counts, one that draws."""
