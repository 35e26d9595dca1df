"""The map of where a drive holds: each cell is the runs it says, and tables, figure and page say what the cells do."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import runtime.study.map as mapping
from model.drives.load import load_drive
from runtime.cli import app
from runtime.drive.fleet import Cases, Fleet
from runtime.drive.scenario import find_scenario
from runtime.estimator.folder import find_folder
from runtime.study.map import Cell, Map, draw_map, map_facts
from runtime.study.map_page import map_figure, speed_table

DRIVE = "spmsm_load_torque"
TASK = find_scenario("load_step", load_drive(DRIVE))


def made(changes: dict[int, dict[str, float]] | None = None) -> Map:
    """Good everywhere with an angle of 1 degree, but for some cells."""
    cells = []
    for psi_m in mapping.FLUXES:
        for R in mapping.RESISTANCES:
            for load in mapping.LOADS:
                for speed in mapping.SPEEDS:
                    own = (changes or {}).get(len(cells), {})
                    usual = {"locked": 1.0, "success": 1.0, "angle": 1.0} | own
                    cells.append(Cell(speed * 1000.0, load * 5.0, R, psi_m, **usual))
    return Map(DRIVE, "ckf", TASK, 4, tuple(cells))


def test_a_cell_is_the_runs_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of eight cells run again alone, with the motor, speed, load and seeds that it names."""
    for name, values in (
        ("SPEEDS", (0.02, 0.2)),
        ("LOADS", (0.0, 1.0)),
        ("RESISTANCES", (0.8, 1.0)),
        ("FLUXES", (1.0,)),
    ):
        monkeypatch.setattr(mapping, name, values)
    found = draw_map(DRIVE, runs=2, seed=5)
    fleet = Fleet(find_folder(DRIVE), found.kind)
    assert len(found.cells) == 8
    for cell in found.cells:
        alone = fleet.run(TASK, Cases(seed=[5, 6], R=cell.R, psi_m=cell.psi_m, load=cell.load, speed=cell.speed))
        assert (cell.locked, cell.success) == (np.mean(alone.locked), np.mean(alone.locked & alone.reached))
        expected = [angle if locked else 180.0 for angle, locked in zip(alone.angle, alone.locked, strict=True)]
        assert cell.angle == pytest.approx(max(expected))
    assert {(cell.speed, cell.load) for cell in found.cells} == {(20.0, 0.0), (20.0, 5.0), (200.0, 0.0), (200.0, 5.0)}
    outcomes = {(cell.locked, cell.success) for cell in found.cells}
    assert outcomes == {(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)}, "R 20 % off: lost at 20 r/min, a wrong speed at 200"


def test_a_map_of_whole_drives_is_the_supervised_fleets(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, values in (("SPEEDS", (0.2,)), ("LOADS", (1.0,)), ("RESISTANCES", (1.0,)), ("FLUXES", (1.0,))):
        monkeypatch.setattr(mapping, name, values)
    (cell,) = draw_map(DRIVE, runs=4, seed=5, supervised=True).cells
    fleet = Fleet(find_folder(DRIVE), "ckf", supervised=True)
    whole = fleet.run(TASK, Cases(seed=[5, 6, 7, 8], load=cell.load, speed=cell.speed))
    assert (cell.locked, cell.success) == (np.mean(whole.locked), np.mean(whole.good))


def test_the_grid_has_the_order_of_its_axes() -> None:
    found = made()
    for name, axis, values in (
        ("psi_m", 0, mapping.FLUXES),
        ("R", 1, mapping.RESISTANCES),
        ("load", 2, [5.0 * load for load in mapping.LOADS]),
        ("speed", 3, [1000.0 * speed for speed in mapping.SPEEDS]),
    ):
        rolled = np.moveaxis(found.grid(name), axis, -1).reshape(-1, len(values))
        np.testing.assert_array_equal(rolled, np.broadcast_to(values, rolled.shape))


def test_the_worst_corner_is_first() -> None:
    found = made({3: {"success": 0.5, "angle": 3.0}, 100: {"success": 0.5, "angle": 9.0}, 200: {"angle": 20.0}})
    assert found.corners[:3] == [found.cells[100], found.cells[3], found.cells[200]]
    facts = map_facts(found)
    assert facts["cells"][0] == vars(found.cells[100])
    assert (facts["rated"], facts["runs"]) == ({"speed": 1000.0, "load": 5.0}, 4)
    lost = map_facts(made({0: {"angle": float("nan")}}))
    assert json.loads(json.dumps(lost, allow_nan=False))["cells"]


def test_the_table_averages_over_loads() -> None:
    """Exact data: five cells; R a tenth off: fifteen; everything: seventy-five; the angle is the largest of them."""
    exact = next(k for k, c in enumerate(made().cells) if (c.psi_m, c.R, c.load, c.speed) == (1.0, 1.0, 5.0, 10.0))
    far = next(k for k, c in enumerate(made().cells) if (c.psi_m, c.R, c.load, c.speed) == (0.95, 1.2, 0.0, 20.0))
    table = speed_table(made({exact: {"success": 0.5, "angle": 40.0}, far: {"success": 0.0, "angle": 180.0}}))
    columns = [[str(cell) for cell in column._cells] for column in table.columns]
    assert columns[0] == ["10", "20", "50", "100", "200", "500", "1000"]
    assert [column[0] for column in columns[1:]] == ["90.0 (40.0)", "96.7 (40.0)", "99.3 (40.0)"]
    assert [column[1] for column in columns[1:]] == ["100.0 (1.0)", "100.0 (1.0)", "98.7 (180.0)"]


def test_the_figure_marks_what_was_lost() -> None:
    healthy, lost = map_figure(made()), map_figure(made({7: {"success": 0.0, "locked": 0.0, "angle": 180.0}}))
    assert healthy != lost


def test_the_command_writes_page_and_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = made({5: {"success": 0.25, "angle": 33.0}})
    monkeypatch.setattr(mapping, "draw_map", lambda *rest: found)
    out, facts = tmp_path / "[a] page", tmp_path / "map.json"
    done = CliRunner().invoke(app, ["study", "map", DRIVE, "--out", str(out), "--json", str(facts)])
    assert done.exit_code == 0, done.output
    assert "Worst: 500 r/min, 0 N m, R 0.8, psi_m 0.95: 25% of 4 runs good." in done.output
    assert json.loads(facts.read_text())["cells"][0]["angle"] == 33.0
    page = (out / "index.html").read_text()
    assert "<td>33.0</td>" in page
    assert "rated are 1000 r/min and 5 N m" in page
    assert page.count("<svg") == 1
    told = re.findall("<title>[^<]*</title>", (out / "map.svg").read_text())
    assert told
    assert all(title in page for title in told)
