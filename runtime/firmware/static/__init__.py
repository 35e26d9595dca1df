"""Gates that read the generated C without running it: compilers, bans, MISRA, and EVA's proof."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from runtime.estimator.folder import GeneratedFolder
from runtime.firmware.static.check import Check


def static_checks(folder: Path, progress: Callable[[str], None] = lambda text: None) -> list[Check]:
    """Every static gate on one generated folder, a few seconds; a gate whose tool is missing says so."""
    from runtime.firmware.static.bans import ban_checks
    from runtime.firmware.static.compilers import compiler_checks
    from runtime.firmware.static.eva import eva_checks
    from runtime.firmware.static.eva_modes import mode_checks
    from runtime.firmware.static.misra import misra_checks
    from runtime.firmware.static.subset import subset_checks

    checks: list[Check] = []
    for gate, words in (
        (compiler_checks, "compilers that complain about everything"),
        (ban_checks, "bans and divisions"),
        (misra_checks, "MISRA C:2012"),
        (subset_checks, "the target's subset of C"),
        (eva_checks, "Frama-C's EVA"),
        (mode_checks, "Frama-C's EVA on the modes"),
    ):
        progress(f"{folder.name}: {words}")
        checks += gate(folder)
    return checks


def static_gate(folder: GeneratedFolder, progress: Callable[[str], None]) -> list[Check]:
    """:func:`static_checks` in the form :data:`runtime.firmware.gates.GATES` wants."""
    return static_checks(folder.path, progress)
