"""Words that are no drive and files that are no recording, and a part of the line that refuses them.

They are read as a shell reads them, in the folder that :mod:`tests.runtime.bad_inputs.place` fills.
"""

from __future__ import annotations

import shlex

from tests.runtime.bad_inputs.place import NO_UTF8, ODD

#: What a command needs beside its drive, so that only one word is wrong.
NEEDS = {
    "export fmu": "--out o.fmu",
    "export sfunction": "--out o.c",
    "export plecs": "--out o.h",
    "export a2l": "--out o.a2l",
    "package": "--for cmake --out pkg",
    "page": "--out pg",
    "pil": "--port simulated --steps 2",
    "record": "--port simulated --seconds 0.1",
    "commission": "--port simulated",
    "replay": "good.npz",
    "identify": "good.npz",
    "compare": "paper_spmsm",
}

#: Words that are no drive, whoever reads them.
NO_DRIVES = [
    ("paper_spmsn", "Did you mean 'paper_spmsm'?"), ("nothing", "no drive 'nothing'"), ("''", "is empty"),
    ("nothing.toml", "no drive 'nothing.toml'"), ("a_file", "no drive 'a_file'"),
    ("a_folder", "not a generated folder"),
    ("folder.toml", "folder.toml"), ("loop.toml", "loop.toml"), ("dangling.toml", "dangling.toml"),
    ("eio.toml", "cannot be read"), ("a_file/x.toml", "no drive"), ("empty.toml", "is missing"),
    ("binary.toml", "UTF-8"), ("nul.toml", "not valid TOML"), ("truncated.toml", "truncated.toml"),
    ("latin1.toml", "UTF-8"), ("bare.toml", "motor is missing"), ("tables.toml", "name is missing"),
    ("numbers.toml", "name is missing"), ("twice.toml", "not valid TOML"), ("odd_name.toml", "name = 'A b[/c]'"),
    ("ns.toml", "model.sample_time = 20 s is outside"), (shlex.quote(f"{ODD}.toml"), "stator_resistance = -2"),
    (shlex.quote(f"{NO_UTF8}.toml"), "no drive"), ("no_manifest", "no manifest.json"), ("manifest_empty", "manifest"),
    ("manifest_braces", "has no 'drive'"), ("manifest_list", "has no 'drive'"), ("manifest_cut", "cannot be read"),
    ("manifest_nan", "has no 'drive'"), ("other_parameters", "manifest.json"), ("facts.toml", "facts.toml"),
    ("machine_raises.toml", "[/red] no"), ("machine_syntax.toml", "syntax.py"), ("machine_leaves.toml", "leaves.py"),
    ("machine_exhausts.toml", "exhausts.py"),
    ("machine_lacks.toml", "has no class 'M'"), ("machine_number.toml", "is no machine"),
    ("machine_plain.toml", "is no machine"), ("machine_abstract.toml", "does not say its"),
    ("machine_imports.toml", "no_such_module_anywhere"), ("machine_binary.toml", "binary.py"),
    ("machine_nowhere.toml", "cannot be read"), ("machine_word.toml", "Did you mean 'surface'?"),
    ("machine_noclass.toml", "names no class"), ("machine_escapes.toml", "passwd.py"),
]  # fmt: skip

#: Files that are no recording.
NO_DATA = [
    ("nothing.csv", "nothing.csv"), ("''", "is empty"), ("a_folder", "a_folder"), ("a_folder.npz", "a_folder.npz"),
    ("a_folder.csv", "a_folder.csv"), ("a_folder.mat", "a_folder.mat"), ("a_folder.mf4", "a_folder.mf4"),
    ("cut.npz", "cut.npz"), ("empty.npz", "empty.npz"), ("text.npz", "text.npz"), ("lacks.npz", "lacks"),
    ("none.npz", "none.npz"), ("rowless.npz", "holds no samples"), ("backwards.npz", "t"), ("still.npz", "t"),
    ("timeless.npz", "t"), ("strings.npz", "u_alpha"), ("shapes.npz", "i_beta"), ("short.npz", "short.npz"),
    ("complex.npz", "i_beta"), ("objects.npz", "objects.npz"), ("slow.npz", "sampled"), ("binary.csv", "binary.csv"),
    ("empty.csv", "empty.csv"), ("header.csv", "header.csv"), ("words.csv", "words.csv"), ("uneven.csv", "line 3"),
    ("nul.csv", "nul.csv"), ("text.mat", "text.mat"), ("cut.mat", "cut.mat"), ("text.mf4", "text.mf4"),
    ("cut.mf4", "cut.mf4"), ("data.xyz", "data.xyz"), ("data.json", "data.json"), ("eio.csv", "eio.csv"),
    (shlex.quote(f"{ODD}.csv"), "a[/b]c[red]"), (shlex.quote(f"{NO_UTF8}.csv"), ".csv"), ("a_file/x.csv", "x.csv"),
    ("/dev/null", "/dev/null"), ("good.toml", "good.toml"),
]  # fmt: skip
