"""Commands that run many drives: ``study`` and ``study tune``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from typer.core import TyperGroup

from model.drives.load import shipped_drives
from runtime.commands.paths import writes_folder
from runtime.commands.terminal import console, counting, say
from runtime.commands.words import DRIVE, Drives, Json
from runtime.study.statement import ANYWHERE, USUAL, VARIABLES
from runtime.system.errors import UserError
from runtime.system.files import write_facts
from runtime.system.values import nearest


class RunByDefault(TyperGroup):
    """``study DRIVE`` means ``study run DRIVE``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words of the command line; where none names a subcommand, ``run`` is meant."""
        if not args or args[0] not in (*self.commands, "-h", "--help"):
            for word in args[:1]:
                if word not in shipped_drives() and not Path(word).exists() and (hint := nearest(word, self.commands)):
                    raise UserError(f"study: '{word}' is no drive, and none of {', '.join(self.commands)}.{hint}")
            args = ["run", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="study",
    cls=RunByDefault,
    no_args_is_help=False,
    help="Monte Carlo: thousands of closed loops, drawn at random. 'study DRIVE...' runs them ('study run --help' "
    "lists its options); 'study tune DRIVE' looks for a better tuning; 'study map DRIVE' draws where it holds.",
)

VARY_HELP = (
    "NAME=LOW:HIGH (evenly), NAME=LOW:HIGH:log, or NAME=VALUE; repeat it. ':rated' behind noise, load or speed: in "
    "shares of what suits the drive. NAME: "
    + ", ".join(f"{name} ({unit})" for name, (unit, *_) in VARIABLES.items())
    + "."
)
Seed = Annotated[int, typer.Option(min=0, max=2**63, help="Of everything drawn: same seed, same runs, anywhere.")]

Supervised = Annotated[
    bool,
    typer.Option(
        "--supervised/--alone", help="From power-up, with the supervisor, theta from anywhere; or the controller alone."
    ),
]


@app.command("run")
def run(
    drives: Drives = None,
    runs: Annotated[int, typer.Option(min=1, max=10**8, help="Of each drive with each filter.")] = 1000,
    filters: Annotated[str, typer.Option(metavar="KINDS", help="Comma-separated: ckf,ickf,ekf,ukf.")] = "ckf,ickf",
    vary: Annotated[
        list[str] | None, typer.Option(metavar="RANGE", help=f"{VARY_HELP} Default: {' '.join(USUAL)}.")
    ] = None,
    scenario: Annotated[str, typer.Option(metavar="NAME", help="no_load or load_step.")] = "load_step",
    supervised: Supervised = False,
    seed: Seed = 1,
    out: Annotated[
        Path | None,
        writes_folder(
            "Runs, figures (svg). Default: build/study/ and a name of the study's own.",
        ),
    ] = None,
    json: Json = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a Dask cluster, tcp://host:8786. Default: this machine.")
    ] = None,
) -> None:
    """How often a drive starts, and how well it runs, over noise, angles, motors and loads drawn at random.

    Every filter meets the same runs. Ctrl-C keeps what is done, and the same command goes on; more --runs add to it.
    """
    from runtime.study.analysis import study_facts
    from runtime.study.figures import write_figures
    from runtime.study.page import write_study
    from runtime.study.run import run_study, state_study
    from runtime.study.tables import groups_table, paired_table
    from runtime.style.figures import pyplot

    pyplot()  # what is missing is said now, not after the runs
    names, usual = drives or shipped_drives(), ANYWHERE if supervised else USUAL
    statement, packages = state_study(names, filters.split(","), scenario, vary or usual, seed, supervised)
    out = out or Path("build") / "study" / statement.digest[:12]
    with bar("runs") as tell:
        study = run_study(statement, packages, runs, out, scheduler, tell)
    if study.groups:
        console.print(groups_table(study))
        paired = paired_table(study)
        if paired is not None:
            console.print()
            console.print(paired)
        paths = write_figures(study)
        say(f"Figures: {', '.join(path.name for path in paths)}")
        say(f"Page: {write_study(study, paths)}")
    if json is not None:
        write_facts(json, study_facts(study))
    if study.interrupted:
        done = sum(len(group.index) for group in study.groups)
        console.print(
            f"interrupted: {done} of {runs * len(packages)} runs are kept in {escape(str(out))}; "
            "the same command goes on.",
            highlight=False,
            soft_wrap=True,
        )
        raise typer.Exit(130)
    say(f"Runs: {out}")


@app.command("tune")
def tune(
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help=DRIVE)],
    trials: Annotated[int, typer.Option(min=1, max=10**6, help="Altogether, those of earlier calls included.")] = 200,
    kind: Annotated[
        str | None, typer.Option("--filter", metavar="KIND", help="Default: the drive file's first.")
    ] = None,
    vary: Annotated[
        list[str] | None, typer.Option(metavar="RANGE", help=f"{VARY_HELP} Default: noise=1:rated.")
    ] = None,
    p0: Annotated[bool, typer.Option("--p0", help="Tune the initial covariance too.")] = False,
    seed: Seed = 1,
    out: Annotated[
        Path | None,
        writes_folder("Trials and figures. Default: build/tune/<drive>_<filter>."),
    ] = None,
    json: Json = None,
) -> None:
    """Look for Q and R: small errors while starting, at speed and in the load step, as far as they go together.

    Ctrl-C keeps what is done, and the same command goes on.
    """
    from runtime.study.figures import write_front
    from runtime.study.tables import front_table, proof_table
    from runtime.study.tune import tune as search
    from runtime.study.tune import tuned_facts
    from runtime.style.figures import pyplot

    pyplot()
    with bar("trials") as tell:
        tuned = search(drive, kind, trials, out, vary or ("noise=1:rated",), seed, p0, tell)
    console.print(front_table(tuned))
    console.print()
    console.print(proof_table(tuned))
    if tuned.recommended == tuned.own:
        console.print(
            "\nNothing that was tried is better than the drive file's tuning in all three; choose by the table."
        )
    else:
        console.print("\nFor the drive file, section \\[filter]:")
        console.print(tuned.lines, highlight=False, markup=False)
    paths = write_front(tuned, tuned.folder)
    say(f"\nTrials and {paths[0].name}: {tuned.folder}")
    if json is not None:
        write_facts(json, tuned_facts(tuned))
    if tuned.interrupted:
        console.print(
            f"interrupted after {len(tuned.points)} of {trials} trials; the same command goes on.", highlight=False
        )
        raise typer.Exit(130)


@app.command("map")
def draw_map(
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help=DRIVE)],
    kind: Annotated[
        str | None, typer.Option("--filter", metavar="KIND", help="Default: the drive file's first.")
    ] = None,
    runs: Annotated[int, typer.Option(min=1, max=10**6, help="Of each cell.")] = 8,
    supervised: Supervised = False,
    seed: Seed = 1,
    out: Annotated[Path | None, writes_folder("Page and figure. Default: build/map/<drive>.")] = None,
    json: Json = None,
) -> None:
    """Where a drive holds: success and angle error over speed x load x wrong R and psi_m, the worst corner first."""
    from runtime.study.map import draw_map as draw
    from runtime.study.map import map_facts
    from runtime.study.map_page import speed_table, write_map
    from runtime.style.figures import pyplot

    pyplot()
    with bar("runs") as tell:
        found = draw(drive, kind, runs, seed, supervised, tell)
    console.print(speed_table(found))
    worst = found.corners[0]
    console.print(
        f"Worst: {worst.speed:.4g} r/min, {worst.load:.3g} N m, R {worst.R:g}, psi_m {worst.psi_m:g}: "
        f"{worst.success:.0%} of {found.runs} runs good.",
        highlight=False,
    )
    page = write_map(found, out or Path("build") / "map" / found.drive)
    say(f"Page: {page}")
    if json is not None:
        write_facts(json, map_facts(found))


@contextmanager
def bar(what: str) -> Iterator[Any]:
    """A progress bar, where there is a terminal, that says what is being run."""
    with counting(what) as update:
        yield lambda done, of, name: update(completed=done, total=of, description=escape(name))
