"""What the (mutated) generator prints now, in memory.

Nothing of the project is imported before a mutated module is in its place.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any


class Fresh:
    """The generator's output for a drive now: a folder in memory, as :class:`GeneratedFolder` would show it."""

    def __init__(self, drive: Any, form: str) -> None:
        from codegen.generate import draft

        made = draft(drive, form)
        self.drive, self.about, self.model = drive.name, made.about, made.about.model
        self.steps, self.listings, self.module = made.steps, made.listings, made.load(drive.name)
        self.manifest = {"states": [{"name": state.name, "unit": state.unit} for state in self.model.states]}

    def text(self, name: str) -> str:
        return self._files[Path(name).name]

    @property
    def _files(self) -> dict[str, str]:
        return _printed(self)


@cache
def _printed(fresh: Fresh) -> dict[str, str]:
    from codegen.render.drive import render_foc
    from codegen.render.drive_lanes import render_drive_lanes
    from codegen.render.filter import render_filter, render_port
    from codegen.render.lanes import render_foc_lanes, render_lanes
    from codegen.render.supervisor import render_supervisor
    from codegen.targets.find import default_target

    files = {"pmsm_port.h": render_port(default_target())}
    for kind, step in fresh.steps.items():
        stem = f"{fresh.drive}_{kind}"
        files[f"{stem}.h"], files[f"{stem}.c"] = render_filter(
            fresh.about, step, fresh.listings, default_target().numbers, []
        )
        files[f"{stem}_foc.h"], files[f"{stem}_foc.c"] = render_foc(fresh.about, kind, [])
        files |= {f"{stem}_{end}": text for end, text in render_supervisor(fresh.about, step, []).items()}
        files[f"{stem}_lanes.h"], files[f"{stem}_lanes.c"] = render_lanes(fresh.about, step, fresh.listings)
        files[f"{stem}_foc_lanes.h"], files[f"{stem}_foc_lanes.c"] = render_foc_lanes(fresh.about, step)
        files[f"{stem}_drive_lanes.h"], files[f"{stem}_drive_lanes.c"] = render_drive_lanes(fresh.about, step)
    return files
