"""A filter in the browser: the page computes what the Python runtime does, to the last bit, and asks nobody."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from runtime.browser.page import write_browser_page
from runtime.drive.experiment import simulate
from runtime.estimator.estimator import load
from runtime.folders.resolve import drive_folder, find_drive
from runtime.recorded.data import read_recorded
from runtime.replay.replay import Settings, replay
from tests.judges.made import command
from tests.target.need import need

#: Currents as states; flux linkages as states, where h and the iteration are at work; behind dead time.
DRIVES = [("paper_spmsm", "ickf"), ("ipmsm_flux", "ickf"), ("servo_24v", "ckf")]
STEPS = 1000


#: The page has loaded once what it was asked for is shown: a document within it stays open for that long.
HELD = """<script>
const held = document.body.appendChild(document.createElement("iframe")).contentDocument;
held.open();
(ASKED).finally(() => held.close());
</script></body>"""


def _seen(page: Path, scratch: Path) -> str:
    """The page as Chromium leaves it once it has loaded, with no network at all."""
    options = [
        "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={scratch / 'profile'}", "--dump-dom",
    ]  # fmt: skip
    done = subprocess.run(
        ["chromium", *options, page.as_uri()], capture_output=True, text=True, check=True, timeout=240
    )
    return done.stdout


def _asked(page: Path, call: str) -> Path:
    """A copy of the page that makes this call instead of the one it begins with, and has loaded when that is done."""
    text = page.read_text(encoding="utf-8")
    copy = page.with_name("asked.html")
    begins = "\nexample();\n"
    assert text.count(begins) == text.count("</body>") == 1
    copy.write_text(text.replace(begins, "\n").replace("</body>", HELD.replace("ASKED", call)), encoding="utf-8")
    return copy


def _with_recording(page: Path, csv: str) -> Path:
    """A recording is dropped: what the drop event hands over goes through ``open``."""
    return _asked(page, f"open(new File([{json.dumps(csv)}], 'my run.csv'))")


def _told(dom: str, fact: str) -> str:
    found = re.search(rf'data-{fact}="([^"]*)"', dom)
    assert found is not None, re.findall(r'<p id="said"[^>]*>([^<]*)', dom)
    return html.unescape(found[1])


@pytest.mark.parametrize(("drive", "kind"), DRIVES)
def test_the_page_has_the_runtimes_bits(drive: str, kind: str, tmp_path: Path) -> None:
    need("clang", "wasm-ld", "chromium")
    page = write_browser_page(drive_folder(drive), kind, find_drive(drive), tmp_path)
    run = simulate(drive, "load_step", (kind,))[0]
    u, y = run.u[:STEPS].astype(np.float32), run.i[:STEPS].astype(np.float32)
    T = find_drive(drive).drive.model.sample_time
    rows = np.column_stack([T * np.arange(1, STEPS + 1), u, y]).tolist()
    csv = "t,u_alpha,u_beta,i_alpha,i_beta\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)
    dom = _seen(_with_recording(page, csv), tmp_path)
    assert f"my run.csv: {STEPS} steps" in dom
    ours = load(drive, filter=kind, backend="c", dtype="float32").run(u, y)
    theirs = np.frombuffer(bytes.fromhex(_told(dom, "x")), "<f4").reshape(STEPS, -1)
    np.testing.assert_array_equal(theirs.view(np.uint32), np.ascontiguousarray(ours.x).view(np.uint32))
    (tmp_path / "run.csv").write_text(csv, encoding="utf-8")
    found = replay(drive_folder(drive), read_recorded(tmp_path / "run.csv"), Settings(kind=kind))
    nu = np.array(json.loads(_told(dom, "nu"))).T
    sigma = np.sqrt(found.innovations.S[:, [0, 2]])
    apart = np.max(np.abs(nu - found.innovations.nu) / sigma, axis=1)
    if drive == "ipmsm_flux":  # replay tells y less the points' mean, which is h(x) but for what bends within P
        assert np.max(apart[STEPS // 2 :]) < 0.1
    else:
        assert np.max(apart) < 1e-3
    assert dom.count('viewBox="0 0 720 170"') == ours.x.shape[1] + 1, "a figure a state, and the innovations"
    assert "speed, r/min" in dom


def test_the_example_runs_at_once_and_bad_recordings_are_told_of(tmp_path: Path) -> None:
    need("clang", "wasm-ld", "chromium")
    page = write_browser_page(drive_folder("paper_spmsm"), "ickf", find_drive("paper_spmsm"), tmp_path)
    dom = _seen(_asked(page, "example()"), tmp_path)
    assert "example: 4000 steps; a status bit was set in 0." in dom
    assert dom.count("true</text>") == 2, "the truth beside speed and angle"
    dom = _seen(_with_recording(page, "t,u_alpha,u_beta,i_alpha\n0,1,2,3\n"), tmp_path)
    assert "my run.csv: the header has no i_beta." in dom
    slow = "t;u_alpha;u_beta;i_alpha;i_beta\n0;1;2;3;4\n0.1;1;2;3;4\n"
    assert "it is sampled every 0.1 s, the filter takes 0.00002 s" in _seen(_with_recording(page, slow), tmp_path)


def test_the_page_asks_nobody(tmp_path: Path) -> None:
    need("clang", "wasm-ld")
    text = write_browser_page(drive_folder("paper_spmsm"), "ckf", find_drive("paper_spmsm"), tmp_path).read_text(
        "utf-8"
    )
    assert not re.search(r"https?://(?!www\.w3\.org)|fetch\(|XMLHttpRequest|<link|src=|import ", text)
    assert len(text) < 500_000


def test_without_wasm_ld_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = shutil.which
    monkeypatch.setattr(
        "shutil.which", lambda name, *rest, **keys: None if name == "wasm-ld" else found(name, *rest, **keys)
    )
    code, said = command("page", "paper_spmsm", "--out", str(tmp_path / "page"))
    assert code == 2
    assert "needs wasm-ld: apt-get install clang lld" in " ".join(said.split())
    assert not (tmp_path / "page").exists()
