"""The frame of every page: first screen, contents, units, figures that tell their values, and nothing from outside."""

from __future__ import annotations

import html
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from markupsafe import Markup

from codegen.render.equations import readable
from model.drives.load import load_drive, shipped_drives
from model.machines.state_space import build
from runtime.drive.figures import run_figure
from runtime.estimator.folder import GENERATED
from runtime.firmware.gates import Gated
from runtime.proof.link_cd import Drift
from runtime.proof.result import IterationEffect
from runtime.proof.trajectory import Trajectory
from runtime.proof.verify import Evidence
from runtime.report.chapter import Chapter
from runtime.report.page import write_page
from runtime.report.symbols import ContradictionError, constant_unit, dimension, dimension_of, symbols
from runtime.style.figures import pyplot, svg_text
from runtime.style.pages import table_markup, with_contents
from runtime.style.pages import write_page as write_parts
from runtime.style.svg import compact_path, themed, with_shared_styles
from runtime.style.tables import columns_table
from tests.judges.made import check, link, proof, row, run
from tests.target.need import need

#: Of all nine drives: what a mail takes.
LARGEST = 1_500_000


def _chapter(name: str = "paper_spmsm") -> Chapter:
    """A chapter whose curves are noise, which no figure can draw with fewer points."""
    drive, rng = load_drive(name), np.random.default_rng(3)
    n, N = len(build(drive).states), 60_000
    exact: Any = None
    drift = {
        variant: Drift(rng.uniform(1e-7, 1e-5, (N, n)), rng.uniform(1e-7, 1e-5, N), exact).envelope()
        for variant in ("ckf", "ickf, cubature gain", "ickf, jacobian gain")
    }
    t, pair, line = 1e-4 * np.arange(4000), rng.normal(size=(4000, 2)), rng.normal(size=4000)
    evidence = Evidence(t, drift, {"cubature": np.abs(line)}, Trajectory(t, pair, pair, line, line, pair))
    noise = rng.normal(size=(2, 4000))
    runs = [run(s, kind, *noise, T=1e-4) for s in ("no_load", "load_step") for kind in drive.filter.kinds]
    rows = [row(stage=f"stage {k}", worst=1e-12 * (k + 1), allowed=1e-9) for k in range(20)]
    links = [link(*rows, name=name, drive=drive.name) for name in ("A-B", "B-C", "D-E", "guard", "modes")]
    gates = Gated(drive.name, tuple(check(name=f"gate {k}") for k in range(20)))
    return Chapter(drive, GENERATED / name, proof(*links, drive=drive.name), evidence, runs, firmware=gates)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "index.html"
    write_page(path, [_chapter(), _chapter("ipmsm_adaptive")])
    return path.read_text(encoding="utf-8")


def _words(text: str) -> str:
    return " ".join(html.unescape(re.sub(r"<(style|svg).*?</\1>|<[^>]*>", " ", text, flags=re.DOTALL)).split())


def test_the_first_screen_tells_in_order(page: str) -> None:
    first = page[page.index('<section class="first">') : page.index("</section>")]
    places = [
        first.index(words)
        for words in (
            "Chain of proof:", ">Proved</h4>", "<b>A-B, B-C</b>", ">Not proved</h4>", "anything on the chip itself",
            ">The motors</h4>", "R, ohm", ">In the closed loop: paper_spmsm, ckf, load_step: locked</h4>", "<svg",
            ">Cost and certificate</h4>", "cycles a step",
        )
    ]  # fmt: skip
    assert places == sorted(places)
    assert first.count("<svg") == 1
    assert "paper_spmsm surface 4 2.875 0.835 0.835 0.175 0.008 1000 5" in _words(first)
    assert page.index("</section>") < page.index('<nav class="contents"') < page.index("<h2")


def test_what_was_not_proved_is_said_of_whom(tmp_path: Path) -> None:
    made = _chapter()
    checks = (check("not run", name="AVR"), check("not proved", name="EVA"), check("failed", name="MISRA"))
    broken = proof(link(row(1.0), name="A-B"), link(name="D-E"), drive="paper_spmsm", unchecked=["f, not checked"])
    gated = Gated("paper_spmsm", checks)
    write_page(
        tmp_path / "a.html", [Chapter(made.drive, made.folder, broken, made.evidence, made.runs, firmware=gated)]
    )
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    said = _words(text[: text.index("</section>")])
    for words in (
        "Chain of proof: BROKEN", "A-B FAILED", "AVR: not run of paper_spmsm", "EVA: not proved of paper_spmsm",
        "MISRA: failed of paper_spmsm", "paper_spmsm: f, not checked",
    ):  # fmt: skip
        assert words in said, words
    proved = said[said.index("Proved") : said.index("Not proved")]
    assert ("D-E" in proved, "A-B" in proved, "firmware" in proved) == (True, False, False)


def test_every_link_of_the_contents_leads_somewhere(page: str) -> None:
    links = re.findall(r'<a href="#([^"]+)"', page[: page.index("</nav>")])
    names = re.findall(r'<h[23] id="([^"]+)"', page)
    assert len(names) == len(set(names)) > 20
    assert set(links) == set(names)
    assert len(re.findall(r"<h[23]", page)) == len(names)
    assert names[0] == "paper_spmsm"
    assert "paper_spmsm-equations" in names


def test_contents_of_headings_that_are_alike() -> None:
    made = with_contents("<!-- contents --><h2>A &amp; B</h2><h3>x</h3><h3>x</h3><h2>A-B</h2><h2 id='z'>Z</h2>")
    assert re.findall(r'<h\d id="([^"]*)"', made) == ["a-b", "a-b-x", "a-b-x-2", "a-b-2"]
    assert with_contents("<!-- contents --><h2>A</h2>") == '<h2 id="a">A</h2>', "one chapter needs no contents"


def test_chapters_with_sections_are_long() -> None:
    """On paper they begin a page."""
    made = with_contents("<!-- contents --><h2>A</h2><h2>B</h2><h3>x</h3><h3>y</h3><h2 id='c'>C</h2><h2>D</h2>")
    assert re.findall(r"<h2[^>]*>", made) == ['<h2 id="a">', '<h2 id="b" class="long">', "<h2 id='c'>", '<h2 id="d">']
    last = with_contents('<h2 id="own">A</h2><h3>x</h3>')
    assert re.findall(r"<h2[^>]*>", last) == ['<h2 id="own" class="long">']


def _paper(page: Path, scratch: Path) -> int:
    """How many sheets a page takes."""
    need("chromium")
    pdf = scratch / "printed.pdf"
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={scratch / 'profile'}"]
    subprocess.run(
        ["chromium", *options, f"--print-to-pdf={pdf}", page.as_uri()], capture_output=True, check=True, timeout=240
    )
    return len(re.findall(rb"/Type /Page\b", pdf.read_bytes()))


def test_only_long_chapters_begin_a_sheet(tmp_path: Path) -> None:
    short = [(f"chapter {k}", ["a few words"]) for k in range(4)]
    write_parts(tmp_path / "short.html", "short", "study", short)
    assert _paper(tmp_path / "short.html", tmp_path) == 1
    long = [(head, [*body, Markup("<h3>a section</h3>")]) for head, body in short]
    write_parts(tmp_path / "long.html", "long", "study", long)
    assert _paper(tmp_path / "long.html", tmp_path) == 5


def test_the_first_screen_of_a_drive_is_one_sheet(tmp_path: Path) -> None:
    write_page(tmp_path / "a.html", [_chapter()])
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    first = text.partition("</section>")[0]
    for more, sheets in ((0, 1), (20, 2)):
        page = f"{first}{'<p>one more</p>' * more}</section></body></html>"
        (tmp_path / "first.html").write_text(page, encoding="utf-8")
        assert _paper(tmp_path / "first.html", tmp_path) == sheets


def test_heads_of_tables_are_repeated_on_every_sheet(page: str) -> None:
    """A browser repeats what stands in thead alone."""
    assert page.count("<table><thead><tr><th") > 20
    assert "<th>" not in re.sub(r"<thead>.*?</thead>", "", page, flags=re.DOTALL)
    table = columns_table("drive", "n")
    table.add_row("a", "1")
    assert table_markup(table).startswith('<div class="scroll"><table><thead><tr><th')


def test_what_never_differs_is_said_and_not_drawn(tmp_path: Path) -> None:
    """A logarithmic axis has no place for zero."""
    made, words = _chapter(), "agree bit for bit: there is nothing to draw"
    for worst in (0.0, 0.25):
        made.evidence.effects["cubature"] = np.full(4000, worst)
        effect = IterationEffect("paper_spmsm", "cubature", worst, {}, True, "rounding")
        chapter = replace(made, proof=proof(*made.proof.links, effects=[effect], drive="paper_spmsm"))
        write_page(tmp_path / "a.html", [chapter])
        text = (tmp_path / "a.html").read_text(encoding="utf-8")
        section = text[text.index(">ICKF against CKF</h3>") : text.index(">Modes of the drive</h3>")]
        assert (words in section, section.count("<svg")) == ((True, 0) if worst == 0.0 else (False, 1))


def test_nothing_comes_from_outside(page: str) -> None:
    """No address but a name space's, no script, no image, no import."""
    assert set(re.findall(r"https?://[^\"' <)]*", page)) <= {
        "http://www.w3.org/2000/svg", "http://www.w3.org/1998/Math/MathML", "http://www.w3.org/1999/xlink",
    }  # fmt: skip
    assert not re.search(r"<script|<link|<img|@import|src=", page)
    assert set(re.findall(r"url\(([^)]*)\)", page)) <= {f"#{name}" for name in re.findall(r' id="([^"]*)"', page)}


def test_a_page_is_for_light_and_dark_and_paper(page: str) -> None:
    """Each colour that a figure asks the page for is known in all three."""
    asked = set(re.findall(r"var\(--([\w-]+)\)", page))
    light, dark, printed = (
        set(re.findall(r"--([\w-]+): ?#", block)) for block in re.findall(r":root \{(.*?)\}", page, re.DOTALL)
    )
    assert asked <= light
    assert light == dark == printed
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page
    assert "{fill:#ffffff}" not in page, "a white ground on dark paper"


def test_a_chapter_is_small(page: str) -> None:
    assert len(page.encode()) < 2 * LARGEST / 9 * 1.3, "of nine the smaller seven make up for it"


@pytest.mark.thorough
def test_the_page_of_all_drives_is_small(tmp_path: Path) -> None:
    write_page(tmp_path / "all.html", [_chapter(name) for name in shipped_drives()])
    assert (tmp_path / "all.html").stat().st_size < LARGEST


#: Units of intermediates, by hand.
BY_HAND = {
    "omega_e": "rad/s", "theta_mid": "rad", "v_d": "V", "i_salient": "A", "torque": "N m", "psi_d_mid": "Wb",
    "emf_step": "A", "decay_now": "1", "coupling": "ohm", "g_alpha": "1", "unsure": "1", "theta_next": "rad",
}  # fmt: skip


@pytest.mark.parametrize("name", shipped_drives())
def test_every_symbol_has_the_unit_that_its_equation_gives(name: str) -> None:
    drive = load_drive(name)
    equations = readable(drive)
    found = {str(s.symbol): s.unit for s in symbols(equations, build(drive).states)}
    constants = {c.name: constant_unit(c, equations.constants) for c in equations.constants}
    assert not any(unit in ("", "?") for unit in (found | constants).values())
    for symbol, unit in found.items():
        assert unit == BY_HAND.get(symbol, unit)
    known = {symbol: dimension_of(unit) for symbol, unit in (found | constants).items()}
    for left, right in (*equations.inverter, *equations.f, *equations.h):
        assert {str(s) for s in (left, *right.free_symbols)} <= known.keys()
        of, stated = dimension(right, known), known[str(left)]
        assert of is not None
        assert stated is not None
        assert of[:3] == stated[:3], left
    for entry in equations.H:
        assert {str(s) for s in entry.free_symbols} <= known.keys()


def test_a_sum_of_unlike_things_is_seen() -> None:
    volt, ampere = sp.symbols("v i")
    with pytest.raises(ContradictionError, match="unlike"):
        dimension(volt + ampere, {"v": dimension_of("V"), "i": dimension_of("A")})


def test_the_page_shows_symbols_and_h_as_a_matrix(page: str) -> None:
    for name in ("paper_spmsm", "ipmsm_adaptive"):
        part = page[page.index(f'<h2 id="{name}"') :]
        drive = load_drive(name)
        assert part[: part.index("<h3 id", part.index("equations") + 9)].count("<mtr>") == 2
        assert part[: part.index("constant</th>")].count("<mtd>") >= 2 * len(build(drive).states)
        for s in symbols(readable(drive), build(drive).states):
            assert (
                f'</math></td><td class="text">{s.unit}</td><td class="text">{html.escape(s.meaning, quote=False)}'
                in (part.replace("&#39;", "'"))
            )


def test_a_figure_tells_the_values_under_the_pointer() -> None:
    one = run(speed_error=np.linspace(0.0, 4.0, 400))
    svg = run_figure([one])
    told = re.findall(r'<path d="M(\d+) (\d+)h(\d+)v(\d+)h-\d+z"><title>([^<]*)</title>', svg)
    (last,) = [words for *_, words in told if "r/min" in words and "time 0.371" in words and "true" not in words][-1:]
    low, high = map(float, re.findall(r"ckf: ([\d.]+) \.\. ([\d.]+) r/min", last)[0])
    assert (low, high) == pytest.approx((3.56, 3.85), abs=0.03)
    assert all(int(width) > 5 for _, _, width, _, _ in told)


def test_bars_points_and_cells_tell_their_values() -> None:
    plt = pyplot()
    figure, axes = plt.subplots(1, 3)
    axes[0].barh([0, 1], [120.0, 60.0], label="words")
    axes[1].plot([1.0, 2.0], [3.0, 4.0], "o", label="a")
    axes[1].set(xlabel="T, us", ylabel="error, r/min")
    axes[2].imshow([[1.0, 2.0], [3.0, 4.0]])
    axes[2].set_xticks([0, 1], ["slow", "fast"])
    axes[2].set_yticks([0, 1], ["light", "heavy"])
    svg = svg_text(figure)
    for words in ("words: 120", "words: 60", "a\n3 r/min\n1 us", "fast, light: 2", "slow, heavy: 3"):
        assert f"<title>{words}</title>" in svg, words


def test_a_small_figure_is_the_same_picture() -> None:
    """Relative tenths are where the points were, within half a tenth each, however many there are."""
    points = np.random.default_rng(5).uniform(0, 500, (300, 2))
    d = "M " + " L ".join(f"{x:.6f} {y:.6f}" for x, y in points)
    at, back = np.zeros(2), []
    for command, words in re.findall(r"([Ml])([^Ml]*)", compact_path(d)):
        numbers = np.array([float(w) for w in re.findall(r"-?\d*\.?\d+", words)]).reshape(-1, 2)
        for pair in numbers:
            at = pair if command == "M" else at + pair
            back.append(at)
    np.testing.assert_allclose(back, points, atol=0.051)
    assert len(compact_path(d)) < len(d) / 2


def test_styles_are_shared_and_each_stroke_keeps_its_own() -> None:
    page = '<head></head><svg a="b"><path style="fill:red" /><path clip-path="url(#c)" style="fill:red" /></svg>'
    made = with_shared_styles(page)
    assert '<path class="c0" /><path class="c1" />' in made
    assert ".c0{fill:red}.c1{clip-path:url(#c);fill:red}" in made
    assert 'class="figure"' in themed('<svg><path d="M0 0" style="fill:#ffffff" /><text>x</text></svg>')
    assert "ffffff" not in themed('<svg><path d="M0 0" style="fill:#ffffff" /><text>x</text></svg>')


def test_tables_and_words_of_users_are_no_markup(tmp_path: Path) -> None:
    table = columns_table("<b>", "n")
    table.add_row("[bold]<i>[/bold]", "1 & 2")
    table.caption = "said <so>"
    write_parts(tmp_path / "p.html", "<title>", "study", [("<h>", [table_markup(table), "a < b", Markup("<hr>")])])
    text = (tmp_path / "p.html").read_text(encoding="utf-8")
    for words in (
        '<th class="text">&lt;b&gt;</th>', '<td class="text">&lt;i&gt;</td><td>1 &amp; 2</td>', "said &lt;so&gt;",
        "<title>&lt;title&gt;</title>", "a &lt; b", "<hr>", ">&lt;h&gt;</h2>", " study.",
    ):  # fmt: skip
        assert words in text, words
