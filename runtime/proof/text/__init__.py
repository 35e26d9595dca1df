"""Reads the generated texts, C and Python, into terms that can be compared: what a step does, in one lane, as one value.

``terms`` are the values, ``c_steps`` and ``python_steps`` carry out the statements of a text on them, ``expressions``
reads the blocks, which are straight lines.
"""
