"""The first screen of the report page: verdict, what was proved and what not, motors, a run, cost and certificate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from codegen.output.folder import read_manifest
from codegen.targets.find import find_target
from model.rating import rating
from runtime.drive.figures import loop_figure
from runtime.drive.simulation import Run
from runtime.recorded.units import RPM
from runtime.report.chapter import Chapter
from runtime.style.svg import themed

#: Links of the chain -> what they show, in a reader's words.
SHOWN = {
    ("model",): "f, h, F and H are those of a second derivation, or of the machine file's own reference",
    ("A-B", "B-C"): "the generated filter is the one that is written by hand: each stage, by equation number, float64",
    ("D-E", "text"): "the C and the float32 NumPy are one program: compared as texts, and bit for bit on recordings",
    ("C-D", "D-chip"): "float32 errs no more than stated over a long run; nor does the chip's arithmetic, as modelled",
    ("guard", "data"): "bad inputs are rejected as stated, and the memory holds what the drive file says",
    ("controller", "supervisor", "modes"): "controller and modes, in every state, do as a second statement says",
}  # fmt: skip

#: What no proof here is about.
NEVER = (
    "that your motor is the drive file's: the filter is proved to be its equations, not these to be a motor",
    "anything on the chip itself: cycles are computed from published ones, its arithmetic is modelled",
    "that the loop below holds in general: it is simulated, with one seed of noise",
)


def first_screen(chapters: Sequence[Chapter]) -> dict[str, Any]:
    """What the template's first screen shows.

    Parameters
    ----------
    chapters : sequence of Chapter
    """
    shown = _shown_run(chapters)
    return {
        "failures": [failure for chapter in chapters for failure in chapter.failures()],
        "proved": list(_proved(chapters)),
        "unproved": [*_unproved(chapters), *NEVER],
        "motors": [_motor(chapter) for chapter in chapters],
        "loop": themed(loop_figure(shown[1])) if shown else "",
        "loop_of": f"{shown[0]}, {shown[1].kind}, {shown[1].scenario.name}: {shown[1].verdict}" if shown else "",
        "costs": [row for chapter in chapters for row in _costs(chapter)],
    }


def _shown_run(chapters: Sequence[Chapter]) -> tuple[str, Run] | None:
    """The first drive's first filter under load."""
    found = [(c.drive.name, run) for c in chapters for run in c.runs]
    return next((pair for pair in found if pair[1].scenario.load), found[0] if found else None)


def _proved(chapters: Sequence[Chapter]) -> Any:
    """Each kind of link that was made and held in every drive, its words and how many numbers were compared."""
    for names, words in SHOWN.items():
        links = [link for chapter in chapters for link in chapter.proof.links if link.name in names]
        if links and all(link.passed for link in links):
            yield ", ".join(dict.fromkeys(link.name for link in links)), words, sum(link.compared for link in links)
    checks = [check for c in chapters if c.firmware for check in c.firmware.checks]
    passed = [check for check in checks if check.state == "passed"]
    if passed and not any(check.state == "failed" for check in checks):
        yield "firmware", f"the C away from the host and under other tools: {len(passed)} of {len(checks)} checks", None


def _unproved(chapters: Sequence[Chapter]) -> Any:
    """What was not shown of these drives, a line each."""
    for chapter in chapters:
        name = chapter.drive.name
        yield from (f"{name}: {what}" for what in chapter.proof.unchecked)
        broken = sorted({link.name for link in chapter.proof.links if not link.passed})
        if broken:
            yield f"{name}: {', '.join(broken)} FAILED"
    for state in ("failed", "not proved", "not run"):
        found: dict[str, list[str]] = {}
        for chapter in chapters:
            for check in chapter.firmware.checks if chapter.firmware else ():
                if check.state == state and chapter.drive.name not in found.setdefault(check.name, []):
                    found[check.name].append(chapter.drive.name)
        yield from (f"{check}: {state} of {', '.join(drives)}" for check, drives in found.items())
    if not any(chapter.firmware for chapter in chapters):
        yield "the C on emulated processors and the static checks: not run (pmsm-ickf run --all)"


def _motor(chapter: Chapter) -> dict[str, Any]:
    """A row of the table of motors: inductances in mH, rated speed in r/min."""
    drive, motor = chapter.drive, chapter.drive.motor
    task = rating(drive)
    return {
        "name": drive.name,
        "machine": drive.model.machine.replace("_", " "),
        "cells": [
            f"{motor.pole_pairs}",
            *(
                f"{value:.4g}"
                for value in (
                    motor.stator_resistance,
                    1e3 * motor.inductance_d,
                    1e3 * motor.inductance_q,
                    motor.magnet_flux,
                    motor.inertia,
                    task.speed * RPM,
                    task.torque,
                    drive.control.dc_link,
                )
            ),
        ],
    }


def _costs(chapter: Chapter) -> list[dict[str, Any]]:
    """A row a filter: cycles, share of the sample time, memory, and the worst of one float32 step."""
    manifest = read_manifest(chapter.folder)
    names = [state["name"] for state in manifest["states"]]
    prices = find_target(chapter.drive.target_name).prices
    rows = []
    for kind, facts in manifest["filters"].items():
        cycles = facts.get("estimated_cycles")
        share = 100 * cycles / (prices.clock * chapter.drive.model.sample_time) if prices and cycles else None
        measured = manifest.get("measured", {}).get(f"{chapter.drive.name}_{kind}_step", {})
        certificate = facts.get("certificate")
        worst = dict(zip(names, certificate["x"], strict=True)) if certificate else {}
        rows.append(
            {
                "name": chapter.drive.name,
                "kind": kind,
                "cells": [
                    f"{cycles:,}" if cycles else "-",
                    f"{share:.0f}" if share is not None else "-",
                    f"{facts['state_words']}",
                    f"{measured.get('stack_bytes', '-')}",
                    f"{measured.get('text_bytes', '-')}",
                    *(f"{worst[name]:.1e}" if name in worst else "-" for name in ("omega", "theta")),
                    f"{certificate['P']:.1e}" if certificate else "-",
                ],
            }
        )
    return rows
