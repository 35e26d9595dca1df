"""The checks that notice a wrong rewriting, quickest first."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

PAPER, FLUX, TORQUE = ("B-C paper_spmsm",), ("B-C ipmsm_flux",), ("B-C spmsm_load_torque",)
SPLIT = ("pytest tests/codegen/test_split.py",)
FACTORED = ("pytest tests/codegen/test_factored.py",)
TRIG = ("pytest tests/codegen/test_trig.py",)
TURNED = ("pytest tests/codegen/test_variants.py -k turned_form",)
PIPELINE = ("pytest tests/codegen/test_passes.py -k 'one_after_another or other_roots'",)
SMALL = ("pytest tests/codegen/test_small_angle.py",)
AFFINE = ("pytest tests/codegen/test_affine.py",)
COUNTED = ("pytest tests/codegen/test_passes.py -k multiplied_once",)


def of(
    kind: str, file: str, *rows: tuple[str, str, str, tuple[str, ...]] | tuple[str, str, str, tuple[str, ...], str]
) -> tuple[Mutant, ...]:
    """A fifth entry of a row says why no check can tell the mutant from the original."""
    return tuple(
        Mutant(kind, f"{file}: {name}", checks, file, old, new, equivalent="".join(why))
        for name, old, new, checks, *why in rows
    )


def pass_checks(name: str) -> tuple[str, ...]:
    """That pass's own test, which is quick; then those of all."""
    return f"pytest tests/codegen/test_passes.py -k 'no_value and {name}'", "pytest tests/codegen/test_passes.py"
