"""The version of this distribution; generated files carry it."""

__version__ = "0.4.0"
