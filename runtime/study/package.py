"""One drive with one filter, packed so that another process or machine can run it."""

from __future__ import annotations

import hashlib
import json
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

from runtime.drive.fleet import HANDWRITTEN, HERE, Cases, Fleet, Outcomes, Progress, fleet_files
from runtime.drive.scenario import Scenario
from runtime.estimator.folder import GeneratedFolder


@dataclass(frozen=True)
class Package:
    """Texts of a generated folder, as many as a fleet needs."""

    drive: str
    kind: str
    files: tuple[tuple[str, str], ...]
    supervised: bool = False

    @property
    def digest(self) -> str:
        """The hash of the code; the simulation around it counts too."""
        own = [(name, (HERE / name).read_text(encoding="utf-8")) for name in HANDWRITTEN]
        facts = json.loads(dict(self.files)["manifest.json"])
        texts = [(name, text) for name, text in self.files if name != "manifest.json"]
        return hashlib.sha256(repr((texts, own, facts["parameters"], self.supervised)).encode()).hexdigest()


def pack(folder: GeneratedFolder, kind: str, supervised: bool = False) -> Package:
    """Read what a fleet needs.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    supervised : bool, optional
        With the modes around the controller.

    Raises
    ------
    UserError
        The folder lacks the filter or was edited.
    """
    names = [*fleet_files(folder, kind, supervised), f"{folder.drive}.py"]
    texts = [("manifest.json", (folder.path / "manifest.json").read_text(encoding="utf-8"))]
    files = tuple(texts + [(name, folder.text(name)) for name in names])
    return Package(folder.drive, kind, files, supervised)


_LOCK = threading.Lock()
_OPEN: dict[str, tuple[Fleet, tempfile.TemporaryDirectory[str]]] = {}


def open_fleet(package: Package) -> Fleet:
    """Open the package's fleet, compiled once a process.

    Parameters
    ----------
    package : Package
    """
    key = package.digest
    with _LOCK:
        if key not in _OPEN:
            scratch = tempfile.TemporaryDirectory(prefix="pmsm-ickf-study-")
            root = Path(scratch.name) / package.drive
            for name, text in package.files:
                (root / name).parent.mkdir(parents=True, exist_ok=True)
                (root / name).write_text(text, encoding="utf-8")
            _OPEN[key] = (Fleet(GeneratedFolder(root), package.kind, package.supervised), scratch)
        return _OPEN[key][0]


def run_package(
    package: Package,
    scenario: Scenario,
    cases: Cases,
    threads: int | None = None,
    progress: Progress = lambda done, of: None,
) -> Outcomes:
    """Run :meth:`runtime.drive.fleet.Fleet.run` wherever this process is.

    Parameters
    ----------
    package : Package
    scenario : Scenario
    cases : Cases
    threads : int, optional
        Default: all processors.
    progress : callable
        Told steps done and of how many.
    """
    return open_fleet(package).run(scenario, cases, threads, progress)
