"""Studies on a Dask cluster: what it lacks is said, a killed worker loses nothing, other versions are refused."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from runtime.study import store as storing
from runtime.study.run import run_study
from runtime.system.errors import UserError
from tests.runtime.studies import SHORT, VARY, same_study, stated


def test_what_a_cluster_needs_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from runtime.study import cluster

    statement, packages = stated()
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    with pytest.raises(UserError, match=r"no Dask scheduler answers at 'tcp://127\.0\.0\.1:1'"):
        run_study(statement, packages, 4, tmp_path, scheduler="tcp://127.0.0.1:1")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match=r"--scheduler needs Dask: pip install 'pmsm-ickf\[study\]'"):
        run_study(statement, packages, 4, tmp_path, scheduler="tcp://127.0.0.1:1")


@pytest.mark.thorough
def test_a_killed_worker_loses_no_finished_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three processes, one killed on the way; what was finished is not run again, and all is as on one machine."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(storing, "CHUNK", 24)
    statement, packages = stated(drive="paper_spmsm", vary=VARY)
    runs = 1200
    here = run_study(statement, packages, runs, tmp_path / "here")
    there = tmp_path / "there"
    killed: list[int] = []
    before: dict[Path, int] = {}
    with distributed.LocalCluster(n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            pids = list(client.run(os.getpid).values())
        assert len(set(pids)) == 3

        def watch(done: int, of: int, what: str) -> None:
            if not killed and of // 4 <= done < of:
                before.update({path: path.stat().st_mtime_ns for path in (there / "runs").glob("*.npz")})
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        study = run_study(statement, packages, runs, there, cluster.scheduler_address, watch)
    assert killed
    assert len(before) >= 2
    assert before.items() <= {path: path.stat().st_mtime_ns for path in (there / "runs").glob("*.npz")}.items()
    same_study(here, study)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (
            RuntimeError("no memory\nand more"),
            r"runs 24 to 47 failed on the cluster at 'tcp://x' \(RuntimeError: no memory\)",
        ),
        (UserError("no C compiler found"), "^no C compiler found$"),
    ],
)
def test_what_fails_on_a_worker_is_one_line(error: Exception, message: str) -> None:
    from runtime.study.cluster import _result

    class Failed:
        def result(self) -> Any:
            raise error

    with pytest.raises(UserError, match=message):
        _result(Failed(), storing.Chunk(0, 24, 24), "tcp://x")


def test_a_worker_with_another_version_is_refused() -> None:
    from runtime.study.cluster import _run_chunk, _Task

    statement, packages = stated()
    with pytest.raises(UserError, match="another version of pmsm-ickf"):
        _run_chunk(packages[0], _Task(SHORT, statement.cases(0, 0, 1), "of other code"))
