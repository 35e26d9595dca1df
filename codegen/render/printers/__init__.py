"""Printers: one a language, each a set of small ``format_`` methods over the same listing."""
