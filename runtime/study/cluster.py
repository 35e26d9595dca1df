"""A study's chunks on a Dask cluster.

What is finished lies in the study's folder here; what a worker took with it
when it died is run again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from runtime.drive.fleet import Cases, Outcomes
from runtime.drive.scenario import Scenario
from runtime.study.package import Package, run_package
from runtime.study.statement import Statement
from runtime.study.store import Chunk, Store
from runtime.system.errors import UserError

#: How long a scheduler may take to answer, s.
PATIENCE = 10.0


@dataclass(frozen=True)
class _Task:
    """One chunk as a worker gets it: its runs were drawn here, so that they are the same whatever machine runs them."""

    scenario: Scenario
    cases: Cases
    digest: str

    @classmethod
    def of(cls, statement: Statement, chunk: Chunk) -> _Task:
        cases = statement.cases(chunk.subject, chunk.first, chunk.count)
        return cls(statement.scenarios[chunk.subject], cases, statement.digests[chunk.subject])


def run_there(
    scheduler: str,
    store: Store,
    packages: Sequence[Package],
    missing: Sequence[Chunk],
    progress: Callable[[int], None],
) -> None:
    """Run chunks on a Dask cluster; each is saved here as it comes back.

    Parameters
    ----------
    scheduler : str
        Its address.
    store : Store
    packages : sequence of Package
    missing : sequence of Chunk
    progress : callable
        Told the runs done.

    Raises
    ------
    UserError
        Dask is not installed, no scheduler answers, or a chunk fails on several workers.
    """
    client, as_completed = _connect(scheduler)
    with client:
        # As results of tasks the packages come back when the worker that holds them dies.
        codes = [client.submit(_same, package, key=f"pmsm-ickf-{package.digest}") for package in packages]
        tasks = {}
        for chunk in missing:
            key = f"pmsm-ickf-{store.statement.digest[:16]}-{chunk.subject}-{chunk.first}-{chunk.count}"
            tasks[client.submit(_run_chunk, codes[chunk.subject], _Task.of(store.statement, chunk), key=key)] = chunk
        done = 0
        waiting = as_completed(list(tasks))
        try:
            for future in waiting:
                chunk = tasks[future]
                store.save(chunk, _result(future, chunk, scheduler))
                future.release()
                done += chunk.count
                progress(done)
        except BaseException:
            client.cancel(list(tasks))
            raise


def _connect(scheduler: str) -> tuple[Any, Any]:
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise UserError("--scheduler needs Dask: pip install 'pmsm-ickf[study]'.") from None
    for name in (
        "distributed",
        "distributed.client",
        "tornado",
        "asyncio",
    ):  # what goes wrong is said here, in one line
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        return Client(scheduler, timeout=PATIENCE), as_completed
    except (OSError, TimeoutError, ValueError) as error:
        raise UserError(f"no Dask scheduler answers at '{scheduler}' ({error}); dask scheduler starts one.") from None


def _result(future: Any, chunk: Chunk, scheduler: str) -> Outcomes:
    """The result of a chunk. If its worker has died since, this waits until another one has run it again."""
    try:
        outcomes: Outcomes = future.result()
    except UserError:
        raise
    except Exception as error:
        runs = f"runs {chunk.first} to {chunk.first + chunk.count - 1}"
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        raise UserError(f"{runs} failed on the cluster at '{scheduler}' ({reason}). Finished ones are kept.") from error
    return outcomes


def _same(package: Package) -> Package:
    return package


def _run_chunk(package: Package, task: _Task) -> Outcomes:
    """On a worker, which has as many tasks at once as it has threads: so one thread each."""
    if package.digest != task.digest:
        raise UserError("a worker of the cluster has another version of pmsm-ickf; install the same one everywhere.")
    return run_package(package, task.scenario, task.cases, threads=1)
