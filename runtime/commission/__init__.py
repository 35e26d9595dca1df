"""A motor turned on its bench by the board, within limits, and its data from what was seen (``commission``)."""
