"""Shares the lanes of a batch among threads: a call into C holds no lock of Python's."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

from runtime.system.errors import UserError

VARIABLE = "PMSM_ICKF_THREADS"

#: Steps below which a thread costs more to start (about 0.1 ms) than it saves.
WORTH_IT = 20_000


def thread_count() -> int:
    """How many threads a batch may use: $PMSM_ICKF_THREADS, else the processors this process may run on.

    Raises
    ------
    UserError
        If the variable is not a positive whole number.
    """
    wanted = os.environ.get(VARIABLE)
    if wanted is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not wanted.isdecimal() or int(wanted) < 1:
        raise UserError(f"{VARIABLE} is '{wanted}'; it needs a positive whole number, such as 2.")
    return int(wanted)


def share_lanes(work: Callable[[int, int], None], lanes: int, group: int, steps: int) -> None:
    """Share lanes among threads, so that every lane is served once and groups are kept whole.

    Parameters
    ----------
    work : callable
        ``work(first, count)`` serves ``count`` lanes from lane ``first`` on.
    lanes : int
        Number of lanes.
    group : int
        Lanes that one call of the C takes side by side.
    steps : int
        Steps of each lane; little work is not worth a thread.
    """
    groups = -(-lanes // group)
    threads = max(1, min(thread_count(), groups, lanes * steps // WORTH_IT))
    edges = [min(lanes, group * (groups * k // threads)) for k in range(threads)] + [lanes]
    ranges = [(begin, end - begin) for begin, end in pairwise(edges)]
    if threads == 1:
        work(*ranges[0])
        return
    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(work, *piece) for piece in ranges]:
            done.result()
