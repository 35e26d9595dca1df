"""The measurements of ``benchmarks/cost.py``: one module a kind of subject, one that counts, one that draws."""
