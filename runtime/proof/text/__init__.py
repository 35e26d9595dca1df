"""Reads the generated texts, C and Python, into terms: what a step does, in one lane, as values to compare.

``terms`` are the values, ``c_steps`` and ``python_steps`` carry out the statements of a text on them, ``expressions``
reads the blocks, which are straight lines.
"""
