"""What each page needs so that its lines can be run; a line is named by its words, without the comment behind it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tests.pages import laid


@dataclass(frozen=True)
class Page:
    """A page's lines are run as they stand, in its order, but for what stands here.

    ``laid``: files that it speaks of, before its first line. ``before``: what is done before a line. ``typed``: what is
    typed at a line. ``instead``: what is run in the place of a line, and why. ``left_out``: lines that are not run, and
    why. ``long``: lines that ``make thorough`` alone runs; no short line needs what they write.
    """

    laid: tuple[Callable[[Path], None], ...] = ()
    before: dict[str, Callable[[Path], None]] = field(default_factory=dict)
    typed: dict[str, str] = field(default_factory=dict)
    instead: dict[str, tuple[str, str]] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    long: tuple[str, ...] = ()

    @property
    def named(self) -> set[str]:
        """Every line that a table names."""
        return {*self.before, *self.typed, *self.instead, *self.left_out, *self.long}


#: Pages that other tests run, with what they say around it.
ELSEWHERE = {
    **dict.fromkeys(
        ("docs/ccs.md", "docs/firmware.md", "docs/regenerate.md", "docs/own_machine.md"), "tests/test_docs.py"
    ),
    "docs/worked_example.md": "tests/test_worked_example.py",
}

_BOARD = "there is no board: the same C in the place of one, behind a pseudo-terminal"
_FEWER = "as many take minutes to hours"
_OWN_ENVIRONMENT = "sets up an environment from a package index, as .ci/run does"
_VERIFY = "pmsm-ickf verify"

_REPLAY = (
    "pmsm-ickf replay my_motor.toml scope.csv --rename Time=t --rename Ia=i_a --rename Ib=i_b --rename Uab=u_ab "
    "--rename Ubc=u_bc --scale Ia=mA"
)

README = Page(
    laid=(laid.scope_with_our_names,),
    instead={
        "cp model/drives/paper_spmsm.toml my_motor.toml": (
            'cp model/drives/paper_spmsm.toml my_motor.toml; sed -i \'s/"paper_spmsm"/"my_motor"/\' my_motor.toml',
            "the comment asks for an edit",
        ),
        _VERIFY: ("pmsm-ickf verify spmsm_load_torque", "every drive takes a quarter of an hour"),
        "pmsm-ickf firmware": ("pmsm-ickf firmware paper_spmsm", "every drive takes a quarter of an hour"),
        "pmsm-ickf starts my_motor.toml --turning --reverse": (
            "pmsm-ickf starts my_motor.toml --turning --reverse --runs 2",
            _FEWER,
        ),
    },
    left_out={
        "make test": "these tests",
        "python3 -m venv .venv && .venv/bin/pip install -e '.[report]' && .venv/bin/pmsm-ickf run": _OWN_ENVIRONMENT,
        "python3 -m venv .venv && .venv/bin/pip install -e '.[dev]' && .venv/bin/python -m pytest -n auto "
        "--dist worksteal -m 'not thorough'": f"{_OWN_ENVIRONMENT}; these tests",
    },
    long=(
        "make run",
        "pmsm-ickf simulate my_motor.toml --out figures",
        "pmsm-ickf verify my_motor.toml",
        _VERIFY,
        "pmsm-ickf firmware",
        "pmsm-ickf simulate spmsm_load_torque --inverter pwm --dead-time 2e-6 --bits 12 --delay 1",
        "pmsm-ickf starts my_motor.toml --turning --reverse",
        "pmsm-ickf compare paper_spmsm spmsm_load_torque ipmsm_flux --out build/compare",
        "pmsm-ickf page my_motor.toml --out build/page",
    ),
)

_APT = "installs packages of the system"
CONTRIBUTING = Page(
    left_out={
        "apt-get install gcc libc6-dev make python3 python3-venv": _APT,
        "apt-get install gcc-avr avr-libc simavr gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm clang "
        "libclang-rt-dev lld cppcheck frama-c-base chromium valgrind g++": _APT,
        "make unit": "these tests, those that are pure Python",
        ".venv/bin/pre-commit install": "writes into the repository's hooks",
    },
)

_PIL = "pmsm-ickf pil --port /dev/ttyUSB0 --ticks-hz 150e6"
_COMMISSION = (
    "pmsm-ickf commission --port {} --facts my_motor_facts.toml --out bench.npz --write my_motor_facts.toml "
    "--drive my_motor.toml"
)
_SIMULATED = "pmsm-ickf commission --port simulated --facts guess.toml --motor true.toml"
BOARD = Page(
    laid=(laid.to_commission,),
    typed={_COMMISSION.format("/dev/ttyUSB0"): "y\n", _SIMULATED: "y\n"},
    instead={
        f"{_PIL} --json board.json": ("pmsm-ickf pil --port simulated --ticks-hz 150e6 --json board.json", _BOARD),
        "pmsm-ickf record --port /dev/ttyUSB0 --out run.npz --plot": (
            "pmsm-ickf record --port simulated --out run.npz --plot --seconds 0.5",
            f"{_BOARD}; and nobody is there to end it by Ctrl-C",
        ),
        _COMMISSION.format("/dev/ttyUSB0"): (f"{_COMMISSION.format('simulated')} --motor true.toml", _BOARD),
    },
    long=(_COMMISSION.format("/dev/ttyUSB0"), _SIMULATED),
)

_OUT = "pmsm-ickf design my_motor_facts.toml --out my_motor.toml"
_CHECK = "pmsm-ickf design my_motor_facts.toml --check"
_WRITE = "pmsm-ickf design my_motor_facts.toml --write my_motor.toml"
_NEW = "pmsm-ickf new my_motor"
DESIGN = Page(
    laid=(laid.facts, laid.answers),
    before={_NEW: laid.no_motor, f"{_NEW} < answers.txt": laid.no_motor},
    typed={_NEW: laid.TYPED},
    long=(_OUT, _CHECK, _WRITE, _NEW, f"{_NEW} < answers.txt"),
)

_EXPLORE_LONG = {
    "pmsm-ickf starts": ("pmsm-ickf starts paper_spmsm --filters ckf --runs 2", f"every drive and filter: {_FEWER}"),
    "pmsm-ickf starts my_motor.toml --runs 1000 --turning --reverse --still --slow --json starts.json": (
        "pmsm-ickf starts my_motor.toml --runs 2 --turning --reverse --still --slow --json starts.json",
        _FEWER,
    ),
    "pmsm-ickf faults": ("pmsm-ickf faults paper_spmsm --filters ckf --seeds 1", f"every drive and filter: {_FEWER}"),
    "pmsm-ickf faults spmsm_load_torque --seeds 100 --only power_cycle,garbage --json faults.json --out build/faults": (
        "pmsm-ickf faults spmsm_load_torque --seeds 2 --only power_cycle,garbage --json faults.json --out build/faults",
        _FEWER,
    ),
    "pmsm-ickf study spmsm_load_torque ipmsm_flux": (
        "pmsm-ickf study spmsm_load_torque ipmsm_flux --runs 16",
        _FEWER,
    ),
    "pmsm-ickf study ipmsm_flux --runs 20000 --vary theta=-180:180 --vary R=0.7:1.4 --out build/angles": (
        "pmsm-ickf study ipmsm_flux --runs 16 --vary theta=-180:180 --vary R=0.7:1.4 --out build/angles",
        _FEWER,
    ),
    "pmsm-ickf study map ipmsm_flux": ("pmsm-ickf study map ipmsm_flux --runs 1", _FEWER),
    "pmsm-ickf study tune ipmsm_flux": ("pmsm-ickf study tune ipmsm_flux --trials 3", _FEWER),
    "python benchmarks/cost.py": (
        "python benchmarks/cost.py --table forms --steps 100",
        "peers are compiled, which takes minutes",
    ),
}
EXPLORE = Page(
    laid=(laid.motor, laid.scope_with_their_names, laid.recording("paper_spmsm", "run.npz")),
    instead=_EXPLORE_LONG,
    left_out={
        "pip install -e '.[study]'": _OWN_ENVIRONMENT,
        "pip install -e '.[bench]'": _OWN_ENVIRONMENT,
    },
    long=(
        *_EXPLORE_LONG,
        "pmsm-ickf simulate",
        "pmsm-ickf simulate --filters ckf,ickf,ekf,ukf --sweep --out build/sim",
        "pmsm-ickf simulate spmsm_load_torque --inverter pwm --dead-time 2e-6 --bits 12 --delay 1",
        "pmsm-ickf replay paper_spmsm run.npz --plots figures --out estimates.npz",
        _REPLAY,
        "pmsm-ickf compare paper_spmsm spmsm_load_torque ipmsm_flux --out build/compare",
        "python benchmarks/batch.py",
        "python benchmarks/generate.py",
        "python benchmarks/simulation.py",
    ),
)

IDENTIFY = Page(
    laid=(laid.on_a_bench, laid.recording("spmsm_load_torque", "run.npz")),
    long=(
        "pmsm-ickf identify my_motor_facts.toml run.csv",
        "pmsm-ickf identify my_motor_facts.toml a.npz b.npz --write my_motor_facts.toml",
        "pmsm-ickf identify spmsm_load_torque run.npz --free R,L,psi_m --json f.json --plots figures",
        _OUT,
    ),
)

INDEX = Page(
    typed={_NEW: laid.TYPED},
    instead={"make run": ("make --dry-run run", "README has the same line, which is run there")},
    long=(_NEW, "pmsm-ickf generate my_motor.toml", "pmsm-ickf simulate my_motor.toml --out build/sim"),
)

PROVE = Page(
    instead={
        _VERIFY: ("pmsm-ickf verify ipmsm_flux", "every drive takes a quarter of an hour"),
        "pmsm-ickf firmware": ("pmsm-ickf firmware --help", "README has the same line, which is run there for a drive"),
        "pmsm-ickf fuzz --json fuzz.json": ("pmsm-ickf fuzz paper_spmsm --executions 2000 --json fuzz.json", _FEWER),
        "pmsm-ickf soak --plots figures": ("pmsm-ickf soak paper_spmsm --steps 10000 --plots figures", _FEWER),
        _PIL: ("pmsm-ickf pil --port simulated --ticks-hz 150e6", _BOARD),
        "pmsm-ickf record --port /dev/ttyUSB0 --out run.npz": (
            "pmsm-ickf record --port simulated --out run.npz --seconds 0.5",
            f"{_BOARD}; and nobody is there to end it by Ctrl-C",
        ),
    },
    long=(
        _VERIFY,
        "pmsm-ickf verify paper_spmsm --json proof.json",
        "pmsm-ickf fuzz --json fuzz.json",
        "pmsm-ickf soak --plots figures",
        _PIL,
        "pmsm-ickf record --port /dev/ttyUSB0 --out run.npz",
    ),
)

#: By the page's path from the root.
PAGES = {
    "README.md": README,
    "CONTRIBUTING.md": CONTRIBUTING,
    "docs/board.md": BOARD,
    "docs/browser.md": Page(),
    "docs/design.md": DESIGN,
    "docs/explore.md": EXPLORE,
    "docs/exports.md": Page(laid=(laid.motor,)),
    "docs/identify.md": IDENTIFY,
    "docs/index.md": INDEX,
    "docs/packages.md": Page(),
    "docs/prove.md": PROVE,
    "docs/recordings.md": Page(laid=(laid.motor, laid.scope_with_their_names)),
}
