"""The result of a proof: one row a stage, one link a comparison, and where two computations first part."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Row:
    """One stage in one link: the worst deviation met and what is allowed (0: identical bits).

    A deviation that is no number becomes infinite: NaN is in no order, and the search for the worst would lose it.
    """

    equation: str
    stage: str
    meaning: str
    worst: float
    allowed: float
    compared: int

    def __post_init__(self) -> None:
        if math.isnan(self.worst):
            object.__setattr__(self, "worst", math.inf)

    @property
    def passed(self) -> bool:
        """Whether the deviation is within what is allowed; NaN is not."""
        return self.worst <= self.allowed

    def __str__(self) -> str:
        return f"{self.stage} (eq. {self.equation}) deviates by {self.worst:.3g}, allowed {self.allowed:.3g}"


@dataclass(frozen=True)
class Divergence:
    """The first place where a link breaks."""

    step: int
    equation: str
    stage: str
    element: str
    expected: float
    found: float
    allowed: str

    def __str__(self) -> str:
        where = f"step {self.step}, {self.stage} (eq. {self.equation}) element {self.element}"
        return (
            f"first divergence at {where}: expected {self.expected:.9g}, found {self.found:.9g}, allowed {self.allowed}"
        )


@dataclass(frozen=True)
class Link:
    """One comparison of the chain: ``name`` ("A-B"), of which filter and gain, on which data."""

    name: str
    claim: str
    drive: str
    kind: str
    gain: str
    data: str
    rows: tuple[Row, ...]
    divergence: Divergence | None = None

    @property
    def passed(self) -> bool:
        """Something was compared, and all of it within what is allowed."""
        return self.divergence is None and self.compared > 0 and all(row.passed for row in self.rows)

    @property
    def worst(self) -> float:
        """Largest deviation of any row (rows of link C-D differ in unit: see :attr:`used`)."""
        return max((row.worst for row in self.rows), default=0.0)

    @property
    def used(self) -> float:
        """Largest share of what is allowed; for links that allow nothing, 0 or infinite."""
        shares = [row.worst / row.allowed if row.allowed else (float("inf") if row.worst else 0.0) for row in self.rows]
        return max(shares, default=0.0)

    @property
    def compared(self) -> int:
        """Numbers compared."""
        return sum(row.compared for row in self.rows)

    @property
    def variant(self) -> str:
        """Filter kind, with the gain where it matters."""
        return f"{self.kind}, {self.gain} gain" if self.kind == "ickf" else self.kind


@dataclass(frozen=True)
class IterationEffect:
    """ICKF against CKF on one trajectory: largest difference of each state in sigmas, and in its unit."""

    drive: str
    gain: str
    in_sigma: float
    by_state: dict[str, float]
    proved_idle: bool
    verdict: str


@dataclass
class Proof:
    """All links of a drive, and what iterating changed."""

    drive: str
    links: list[Link] = field(default_factory=list)
    effects: list[IterationEffect] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    #: A link that nothing is there to check against; "proved" is never said of it.
    unchecked: list[str] = field(default_factory=list)
    #: It was made by an earlier run, of the same sources with the same tools.
    kept: bool = False

    @property
    def verdict(self) -> str:
        """In words: "proved", and of what not."""
        if not self.passed:
            return "NOT proved"
        return f"filters proved; {'; '.join(self.unchecked)}" if self.unchecked else "proved"

    @property
    def passed(self) -> bool:
        """Whether every link passed, and there is one."""
        return (
            bool(self.links)
            and all(link.passed for link in self.links)
            and all(e.verdict != "unexplained" for e in self.effects)
        )

    def failures(self) -> Iterable[str]:
        """One line for each broken link, as the command line prints it."""
        for link in self.links:
            if not link.passed:
                where = f"verify {link.drive}/{link.kind} ({link.gain} gain), link {link.name} on {link.data}: "
                broken = next((row for row in link.rows if not row.passed), None)
                yield where + (str(link.divergence) if link.divergence is not None else str(broken))

    def to_json(self) -> dict[str, Any]:
        """Plain data for ``--json``."""
        links = [{**asdict(link), "passed": link.passed, "worst": link.worst} for link in self.links]
        return {
            "drive": self.drive,
            "passed": self.passed,
            "kept": self.kept,
            "links": links,
            "iteration": [asdict(e) for e in self.effects],
            "notes": self.notes,
            "unchecked": self.unchecked,
        }
