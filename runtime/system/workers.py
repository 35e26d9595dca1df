"""Processes that share the work of one command, and end with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

Submit = Callable[..., Future[Any]]


@contextmanager
def workers(count: int) -> Iterator[Submit]:
    """``submit(work, *arguments)`` to at most ``count`` processes, which end when the block does.

    Ctrl-C reaches the command alone, never its workers. Whatever leaves the block early kills them: a polite signal
    would be an exception in the worker, and CasADi swallows those. Their temporary files lie in one folder, removed
    here, so that even a killed worker leaves nothing.
    """
    earlier = {child.pid for child in multiprocessing.active_children()}
    with (
        tempfile.TemporaryDirectory(prefix="pmsm-ickf-", ignore_cleanup_errors=True) as scratch,
        ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _begin, (scratch,)) as pool,
    ):

        def submit(work: Callable[..., Any], *arguments: Any) -> Future[Any]:
            with _without_ctrl_c():
                return pool.submit(work, *arguments)

        try:
            yield submit
        except BaseException:
            for child in multiprocessing.active_children():
                if child.pid not in earlier:
                    child.kill()
            pool.shutdown(cancel_futures=True)
            raise


def _begin(scratch: str) -> None:
    os.environ["TMPDIR"] = tempfile.tempdir = scratch


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Ctrl-C waits until the end of the block; a process started in it never sees one."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
