"""Cycles of a step on a chip, computed from published ones: every filter, controller and whole interrupt.

Run: python benchmarks/cycles.py [DRIVE...]                  of the shipped drives, as their folders have them
     python benchmarks/cycles.py --target f28379d [DRIVE...] the same drives printed for another target with prices
     --json F                                                the tables as JSON

At the worst of every branch and the typical price; shares are of the drive's own sample time. Nothing is run.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path

from codegen.evidence.budget import Account, share
from codegen.evidence.ledger import Ledger
from codegen.generate import count, generate_bare
from codegen.targets.find import default_target, find_target
from model.drives.load import load_drive, shipped_drives
from model.schema import Drive
from model.supervisor.table import MODES
from runtime.estimator.folder import GENERATED
from runtime.folders.generate import for_target

Row = dict[str, str]
COLUMNS = ("step", "with controller", *(f"interrupt, {mode.name}" for mode in MODES if mode.runs))
#: What does not end within the sample time.
LATE = "**{}**"


def accounts(drive: Drive, target: str) -> Mapping[str, Account]:
    """The cost of a drive's filters: of the folder where it is for this target, else of a text made for it."""
    if drive.target_name == target and (GENERATED / drive.name).is_dir():
        folder = GENERATED / drive.name
        return count(drive, {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.[ch]")})
    made = generate_bare(for_target(drive, target))
    return count(made.drive, made.files)


def rows(drive: Drive, target: str) -> list[Row]:
    """One row a filter; a cell has cycles and their share of the sample time, in bold beyond it."""
    found = []
    for kind, account in accounts(drive, target).items():
        modes = {f"interrupt, {mode}": ledger for mode, ledger in account.interrupts.items()}
        ledgers = {"step": account.filter, "with controller": account.controller, **modes}
        cells = {name: _cell(account, ledgers[name], drive) if name in ledgers else "" for name in COLUMNS}
        found.append(
            {"drive": f"`{drive.name}`", "filter": kind, "T": f"{drive.model.sample_time * 1e6:g} us", **cells}
        )
    return found


def _cell(account: Account, ledger: Ledger, drive: Drive) -> str:
    assert account.prices is not None
    cycles = account.prices.total(ledger.operations, account.prices.factors[0])
    part = share(ledger.operations, drive, account.prices)
    text = f"{cycles} ({100 * part:.0f} %)"
    return LATE.format(text) if part > 1 else text


def table(drives: list[str], target: str) -> dict[str, object]:
    """The table as ``docs/results`` keeps it."""
    prices = find_target(target).prices
    if prices is None:
        raise SystemExit(f"for {find_target(target).title} nothing is published that prices a step.")
    return {
        "title": f"{find_target(target).title}, {prices.clock / 1e6:g} MHz, k = {prices.factors[0]:g}: {prices.sum}",
        "rows": [row for name in drives for row in rows(load_drive(name), target)],
    }


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drives", nargs="*", metavar="DRIVE")
    parser.add_argument("--target", default=default_target().name)
    parser.add_argument("--json", type=Path, metavar="F")
    given = parser.parse_args()
    found = table(given.drives or list(shipped_drives()), given.target)
    if given.json:
        given.json.write_text(json.dumps({"cycles": found}, indent=1) + "\n", encoding="utf-8")
    print(found["title"])
    for row in found["rows"]:  # type: ignore[attr-defined]
        said = [f"{name} {value.replace('**', '')}" for name, value in row.items() if value]
        print("  " + ", ".join(said))


if __name__ == "__main__":
    main()
