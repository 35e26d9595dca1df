"""The lists of mutants: wrong data, wrong equations, wrong filters, wrong rewriting, a wrong controller, errors around them,
wrong judges, wrong designs."""

from __future__ import annotations

from tests.mutants.catalogue.alignment import ALIGNMENT
from tests.mutants.catalogue.control import CONTROL
from tests.mutants.catalogue.data import data_mutants
from tests.mutants.catalogue.design import DESIGN
from tests.mutants.catalogue.drive_lanes import DRIVE_LANES
from tests.mutants.catalogue.fast import FORM
from tests.mutants.catalogue.filters import FILTERS
from tests.mutants.catalogue.inverter import INVERTER
from tests.mutants.catalogue.judges import JUDGES
from tests.mutants.catalogue.model import MODEL
from tests.mutants.catalogue.passes import ARITHMETIC, PASS
from tests.mutants.catalogue.program import PROGRAM
from tests.mutants.catalogue.recordings import RECORDINGS
from tests.mutants.catalogue.supervisor import SUPERVISOR
from tests.mutants.catalogue.surroundings import SURROUNDINGS
from tests.mutants.catalogue.tolerance import TOLERANCE
from tests.mutants.catalogue.wave import WAVE
from tests.mutants.mutant import Mutant

SOURCES: tuple[Mutant, ...] = (
    *MODEL,
    *INVERTER,
    *FILTERS,
    *TOLERANCE,
    *FORM,
    *PROGRAM,
    *PASS,
    *ARITHMETIC,
    *CONTROL,
    *SUPERVISOR,
    *WAVE,
    *ALIGNMENT,
    *DRIVE_LANES,
    *SURROUNDINGS,
    *JUDGES,
    *RECORDINGS,
    *DESIGN,
)

__all__ = ["SOURCES", "data_mutants"]
