"""Groups of commands: words and exit codes, as in :mod:`runtime.cli`, which registers them."""
