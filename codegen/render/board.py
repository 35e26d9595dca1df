"""The bench's side of a drive's folder: frames, processor in the loop, telemetry (``board/``)."""

from __future__ import annotations

from codegen.output.folder import digest
from codegen.output.version import __version__
from codegen.render.fill import render
from codegen.render.filter import Description
from model.filters import FilterStep

#: Where the bench's files go; production needs none of them.
BOARD = "board"
#: Raised when a frame's meaning changes.
PROTOCOL = 1
#: What serves every filter.
SHARED = (
    *(
        f"{stem}{end}"
        for stem in ("pmsm_link", "pmsm_pil", "pmsm_telemetry", "pmsm_commission")
        for end in (".h", ".c")
    ),
    "pmsm_commission_talk.c",
)
#: Bytes of a frame without COBS: one COBS code reaches across 254.
FRAME_MAX = 250


def identity(drive: str, kind: str, sha: str, source: str) -> str:
    """The identity that a board sends when asked for it.

    Parameters
    ----------
    drive : str
        The drive's name.
    kind : str
        Filter kind, such as "ickf".
    sha : str
        Hash of the drive file, in hexadecimal digits; 16 of them are sent.
    source : str
        Text of the filter's C for the chip.

    >>> identity("d", "ckf", "0123456789abcdef" * 4, "text").split()[:3]
    ['d', 'ckf', '0123456789abcdef']
    """
    return f"{drive} {kind} {sha[:16]} {digest(source)[:16]} {__version__}"


def render_board(about: Description, steps: dict[str, FilterStep], sources: dict[str, str]) -> dict[str, str]:
    """File texts by path: the shared ones, and one binding a filter.

    Parameters
    ----------
    steps : dict
        Filter kind -> step, which names the field of n (n + 1) / 2 covariance words; they are sent as they are.
    sources : dict
        Filter kind -> text of its ``.c``, which its identity names by hash.
    """
    n = len(about.model.states)
    packed = n * (n + 1) // 2
    drive = about.drive
    example = f"{drive.name}_{next(iter(sources))}"
    longest = max(11 + len(identity(drive.name, kind, drive.sha256, text)) for kind, text in sources.items())
    payload = max(8 + 4 * (n + packed + 2), longest)
    assert payload + 7 <= FRAME_MAX, f"{payload} bytes of state or name do not fit a frame"
    files = {
        f"{BOARD}/{name}": render(f"{name}.j2", frame_max=FRAME_MAX, protocol=PROTOCOL, example=example)
        for name in SHARED
    }
    for kind, source in sources.items():
        p = f"{drive.name}_{kind}"
        text = identity(drive.name, kind, drive.sha256, source)
        common = {"p": p, "drive": drive.name, "sha": drive.sha256}
        files[f"{BOARD}/{p}_pil.h"] = render("filter_pil.h.j2", **common)
        files[f"{BOARD}/{p}_pil.c"] = render(
            "filter_pil.c.j2",
            **common,
            identity=text,
            codes={letter: ord(letter) for letter in text},
            covariance=steps[kind].covariance,
            n=n,
            packed=packed,
        )
    return files
