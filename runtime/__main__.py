"""The entry point of ``pmsm-ickf``: Ctrl-C is one line while the libraries are still loading, too."""

from __future__ import annotations

import gc

from runtime.system.errors import end_interrupted, remember_interrupts, stop_if_interrupted, was_interrupted


def main() -> None:
    """Load the command line and run it."""
    remember_interrupts()
    gc.disable()  # nothing that is loaded is garbage, and a tenth of the time to load went into looking for it
    try:
        from runtime.cli import main as run

        gc.freeze()
        gc.enable()
        stop_if_interrupted()
    except BaseException:
        if was_interrupted():  # by the time it arrives here it may be another error: libraries make one of it
            end_interrupted()
        raise
    run()


if __name__ == "__main__":
    main()
