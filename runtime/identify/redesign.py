"""The filter before and after: what design makes of the guesses and of what was found, on the same recordings."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from codegen.generate import generate_bare
from codegen.output.folder import write_folder
from model.drives.load import parse_drive
from model.schema import Drive, DriveError
from runtime.design.facts import Facts
from runtime.design.rules import design
from runtime.estimator.estimator import load_folder
from runtime.estimator.folder import GeneratedFolder
from runtime.identify.identify import Identified
from runtime.replay.replay import Replay, Settings, replay, start
from runtime.system.errors import UserError

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Compared:
    """The filter's runs over each recording: as it was, and as redesigned from what was found."""

    before: tuple[Replay, ...]
    after: tuple[Replay, ...]


def redesigned(facts: Facts) -> Drive:
    """The drive that the rules of design make of facts.

    Parameters
    ----------
    facts : Facts

    Raises
    ------
    UserError
        Facts that no drive file can hold.
    """
    try:
        return parse_drive(design(facts).tables(), facts.name)
    except DriveError as error:
        raise UserError(f"these facts make a drive file that is refused: {error}") from None


def compare(found: Identified, progress: Progress = lambda text, share: None) -> Compared:
    """Run both filters over all recordings; each starts at the angle and the speed that were found.

    Parameters
    ----------
    found : Identified
    progress : callable, optional
    """
    subject = found.problem.subject
    drives = (redesigned(subject.facts) if subject.from_facts else subject.drive, redesigned(found.facts))
    runs: list[tuple[Replay, ...]] = []
    with ExitStack() as stack:
        for k, (drive, word) in enumerate(zip(drives, ("as it was", "redesigned"), strict=True)):
            progress(f"the filter {word}", 0.5 * k)
            folder = _generated(drive, stack)
            runs.append(tuple(_run(found, folder, drive, k) for k in range(len(found.problem.recordings))))
    return Compared(*runs)


def _generated(drive: Drive, stack: ExitStack) -> GeneratedFolder:
    path = Path(stack.enter_context(tempfile.TemporaryDirectory())) / drive.name
    kind = drive.filter.kinds[0]
    bare = drive.model_copy(update={"filter": drive.filter.model_copy(update={"kinds": [kind]})})
    write_folder(path, generate_bare(bare).files)
    return GeneratedFolder(path)


def _run(found: Identified, folder: GeneratedFolder, drive: Drive, recording: int) -> Replay:
    kind, recorded = drive.filter.kinds[0], found.problem.recordings[recording].recorded
    theta, omega = (_begin(found, f"{name} {recording}") for name in ("theta", "omega"))
    x = start(load_folder(folder, kind, "c", "float32"), Settings(kind, theta0=theta))
    assert x is not None
    x[2] = omega
    return replay(folder, recorded, Settings(kind, x0=tuple(x.tolist())))


def _begin(found: Identified, name: str) -> float:
    """What was found of a recording's beginning."""
    k = found.problem.index(name)
    return float(found.problem.unknowns[k].value(found.found.q[k]))
