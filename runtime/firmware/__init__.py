"""The generated C away from the host: stand-in processors, static gates, and what they found.

Nothing here runs on the chip itself; :mod:`runtime.board` does that, on the user's own board.
"""
