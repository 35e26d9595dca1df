"""The entry point of ``pmsm-ickf``: Ctrl-C is one line while the libraries are still loading, too."""

from __future__ import annotations

from runtime.system.collector import end_without_search, loading
from runtime.system.errors import end_interrupted, remember_interrupts, stop_if_interrupted, was_interrupted
from runtime.system.streams import open_streams


def main() -> None:
    """Load the command line and run it."""
    open_streams()
    remember_interrupts()
    end_without_search()
    try:
        with loading():
            from runtime.cli import main as run
        stop_if_interrupted()
    except BaseException:
        if was_interrupted():  # by the time it arrives here it may be another error: libraries make one of it
            end_interrupted()
        raise
    run()


if __name__ == "__main__":
    main()
