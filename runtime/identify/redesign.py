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
from runtime.estimator.folder import GeneratedFolder
from runtime.identify.identify import Identified
from runtime.replay.replay import Replay, Settings, replay
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
    """Run both filters over all recordings; each starts at the angle that was found.

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
    problem = found.problem
    k = problem.index(f"theta {recording}")
    theta = float(problem.unknowns[k].value(found.found.q[k]))
    settings = Settings(drive.filter.kinds[0], "c", "float32", theta0=theta)
    return replay(folder, problem.recordings[recording].recorded, settings)
