"""Processes that share the work of one command, and end with it."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import queue
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from runtime.system.collector import end_without_search

Submit = Callable[..., Future[Any]]
Progress = Callable[[str], None]

#: The signal that ends a command: it reaches the command alone, which ends its workers.
POLITE = {signal.SIGINT, signal.SIGTERM}


@contextmanager
def workers(count: int, words: Any = None) -> Iterator[Submit]:
    """``submit(work, *arguments)`` to at most ``count`` processes, which end when the block does.

    Ctrl-C and SIGTERM reach the command alone, never its workers. Whatever leaves the block early kills them and what
    they have started: a polite signal would be an exception in the worker, and CasADi swallows those. A worker whose
    command was killed ends by itself. Their temporary files lie in one folder, removed here, so that even a killed
    worker leaves nothing.

    Parameters
    ----------
    count : int
    words : multiprocessing queue, optional
        Where :func:`say` puts what a worker has to tell; :func:`share` has one.
    """
    earlier = {child.pid for child in multiprocessing.active_children()}
    with (
        tempfile.TemporaryDirectory(prefix="pmsm-ickf-", ignore_cleanup_errors=True) as scratch,
        ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _begin, (scratch, words)) as pool,
    ):

        def submit(work: Callable[..., Any], *arguments: Any) -> Future[Any]:
            with _without_polite_signals():
                return pool.submit(work, *arguments)

        try:
            yield submit
        except BaseException:
            for child in multiprocessing.active_children():
                if child.pid not in earlier and child.pid is not None:
                    kill_descendants(child.pid)
                    child.kill()
            pool.shutdown(cancel_futures=True)
            raise


def share(count: int, work: Callable[..., Any], items: Sequence[Any], progress: Progress) -> list[Any]:
    """``work(item)`` for every item, in at most ``count`` processes; what they :func:`say` goes to ``progress``."""
    words = new_words()
    with workers(count, words) as submit:
        return results([submit(work, item) for item in items], words, progress)


def new_words() -> Any:
    """A queue for what workers :func:`say`."""
    return multiprocessing.get_context("spawn").Queue()


def results(futures: Sequence[Future[Any]], words: Any, progress: Progress) -> list[Any]:
    """The results of the workers, in the order asked; their words go to ``progress`` meanwhile. An error ends it."""
    while not all(future.done() for future in futures):
        for future in futures:
            if future.done():
                future.result()
        with contextlib.suppress(queue.Empty):
            progress(words.get(timeout=0.2))
    return [future.result() for future in futures]


_words: Any = None


def say(text: str) -> None:
    """In a worker: a few words for the command's terminal."""
    if _words is not None:
        _words.put(text)


#: New objects after which a worker looks for circles among them; Python's 700 has it look through what it still loads.
COLLECTED_EVERY = 20_000


def _begin(scratch: str, words: Any) -> None:
    global _words
    gc.set_threshold(COLLECTED_EVERY, 20, 20)
    end_without_search()
    _words = words
    os.environ["TMPDIR"] = tempfile.tempdir = scratch
    threading.Thread(target=_end_with_the_command, daemon=True).start()


def _end_with_the_command() -> None:
    """A worker whose command is gone (SIGKILL leaves it no time) ends, and what it has started."""
    command = multiprocessing.parent_process()
    if command is not None:
        wait([command.sentinel])
        kill_descendants(os.getpid())
        os._exit(1)


@contextmanager
def _without_polite_signals() -> Iterator[None]:
    """They wait until the end of the block; a process started in it never sees one."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, POLITE)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def kill_descendants(ancestor: int) -> None:
    """Kill every process that descends from one, compilers and emulators above all; none where there is no /proc.

    Each is stopped first, so that none starts another while they are counted. What multiprocessing keeps beside the
    workers ends by itself, and would be missed before.
    """
    stopped: set[int] = set()
    kept = {getattr(resource_tracker._resource_tracker, "_pid", None)}
    while new := _descendants(ancestor) - stopped - kept:
        for process in new:
            _signal(process, signal.SIGSTOP)
        stopped |= new
    for process in stopped:
        _signal(process, signal.SIGKILL)


def _signal(process: int, number: int) -> None:
    try:
        os.kill(process, number)
    except (ProcessLookupError, PermissionError):  # it is gone, or no longer ours
        return


def _descendants(ancestor: int) -> set[int]:
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = stat.read_text(errors="replace").rpartition(")")[2].split()[1]
        except (OSError, IndexError):  # it has ended meanwhile
            continue
        children.setdefault(int(parent), []).append(int(stat.parent.name))
    found, stack = set[int](), [ancestor]
    while stack:
        below = children.get(stack.pop(), [])
        found |= set(below)
        stack += below
    return found
