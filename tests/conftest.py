"""Shared pieces: the drives under test, variants of them, and a cache that does not touch the user's."""

from __future__ import annotations

import gc
import os
import sys
import tempfile
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import pytest
from hypothesis import settings

from codegen.evidence.budget import Account
from codegen.generate import Package, count, generate_bare
from model.drives.load import load_drive, shipped_drives
from model.schema import Drive
from runtime.drive.scenario import scenarios
from runtime.estimator.folder import GENERATED
from tests.features import fewest

os.environ.setdefault("PMSM_ICKF_CACHE", os.path.join(tempfile.gettempdir(), "pmsm-ickf-tests"))
# A test makes what it judges, for it may have planted a fault; those of what is kept take this back.
os.environ.setdefault("PMSM_ICKF_FRESH", "1")

#: Examples that Hypothesis draws: few, or as many as ``--hypothesis-profile many`` of ``make thorough`` asks for.
settings.register_profile("few", max_examples=8)
settings.register_profile("many", max_examples=40)
settings.load_profile("few")

#: The fewest that have every feature between them: what most tests run on.
DRIVES = fewest()
#: The paper's scenarios, which are every shipped drive's: 1000 r/min, 5 N m.
TASKS = scenarios(load_drive("paper_spmsm"))
#: All of them, for what is cheap or must hold for each.
ALL_DRIVES = tuple(shipped_drives())


def thoroughly(*cases: Any) -> list[Any]:
    """Cases of a parametrised test that ``make thorough`` adds to those of ``make test``.

    >>> [case.marks[0].name for case in thoroughly("ipmsm", "ipmsm_flux")]
    ['thorough', 'thorough']
    """
    return [pytest.param(*case if isinstance(case, tuple) else (case,), marks=pytest.mark.thorough) for case in cases]


#: All of them, where that takes long: those with every feature in ``make test``, the others thoroughly.
EVERY_DRIVE = [*DRIVES, *thoroughly(*(name for name in ALL_DRIVES if name not in DRIVES))]
#: The parts of a proof.
LINKS = {
    *("model", "modes", "A-B", "B-C", "guard", "data", "text", "C-D", "D-E", "controller", "supervisor", "D-chip"),
}


def variant(drive: Drive, **changes: dict[str, Any]) -> Drive:
    """A drive with some keys of some sections replaced: ``variant(d, filter={"gain": "cubature"})``."""
    return drive.model_copy(
        update={name: getattr(drive, name).model_copy(update=keys) for name, keys in changes.items()}
    )


def shipped_c(name: str) -> dict[str, str]:
    """The C of a shipped drive for the chip, by file: what is generated and, generate --check says, current."""
    folder = GENERATED / name
    return {f"{path.relative_to(folder)}": path.read_text(encoding="utf-8") for path in folder.glob("*.[ch]")}


@lru_cache(maxsize=8)
def shipped_accounts(name: str) -> dict[str, Account]:
    """The cost of a shipped drive's filters, read from its generated folder; once a process."""
    return count(load_drive(name), shipped_c(name))


@lru_cache(maxsize=8)
def bare_package(name: str, form: str = "fast") -> Package:
    """A shipped drive generated in memory, all that computes and no evidence, once a process: to read and to copy."""
    return generate_bare(load_drive(name), form)


def pytest_collection_finish() -> None:
    """What collecting has loaded stays: the garbage collector need not go through it again and again.

    Graphs and terms by the hundred thousand are made without a circle; a sixth of the time went into looking for one.
    """
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


_unit = False


def _no_program(event: str, arguments: tuple[Any, ...]) -> None:
    if _unit and event in {"subprocess.Popen", "os.posix_spawn", "os.fork", "os.system"}:
        raise RuntimeError(f"a test marked unit starts a program: {arguments[:2]}")


sys.addaudithook(_no_program)


@pytest.fixture(autouse=True)
def _unit_tests_start_no_program(request: pytest.FixtureRequest) -> Iterator[None]:
    global _unit
    _unit = request.node.get_closest_marker("unit") is not None and request.node.get_closest_marker("process") is None
    yield
    _unit = False


@pytest.fixture(params=DRIVES)
def drive(request: pytest.FixtureRequest) -> Drive:
    return load_drive(request.param)
