"""From recordings to motor data, whole: what the command and scripts call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from runtime.identify.intervals import Result, result
from runtime.identify.problem import Problem
from runtime.identify.rows import rows_of
from runtime.identify.search import Found, search
from runtime.identify.subject import Subject, with_found
from runtime.recorded.data import Recorded

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Identified:
    """A search that ended, with what it says of each datum."""

    problem: Problem
    found: Found
    result: Result

    @property
    def facts(self) -> Any:
        """The subject's facts with what is told in them."""
        told = {e.datum.word: (e.value, e.width) for e in self.result.estimates if e.told}
        return with_found(self.problem.subject.facts, told)


def identify(
    subject: Subject, recordings: Sequence[Recorded], progress: Progress = lambda text, share: None
) -> Identified:
    """Motor data of a subject, by maximum likelihood of the innovations of its model.

    Parameters
    ----------
    subject : Subject
    recordings : sequence of Recorded
        Of one motor; each starts anywhere.
    progress : callable, optional
        Told what is being done and the share of it that is done.

    Raises
    ------
    UserError
        Recordings that do not fit the subject, or that no filter follows.
    """
    facts = subject.facts
    rows = tuple(rows_of(recorded, facts.T, facts.dc_link, subject.name) for recorded in recordings)
    problem = Problem(subject, rows)
    progress("compiling", 0.0)
    _ = problem.kernel
    found = search(problem, progress)
    return Identified(found.problem, found, result(found.problem, found))
