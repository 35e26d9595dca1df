"""Recorded data of any origin: formats, units, clocks, and the truth beside them."""
