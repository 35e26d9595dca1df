"""The mutation score of the proof: wrong drives, models, filters, passes and texts, each of which must be caught.

``python -m tests.mutants`` runs them all, prints the table and writes ``build/mutants.json`` and ``docs/mutants.md``.

A mutant is one small error. It is killed when a link of ``verify`` does not pass or a test's assertion fails; a crash
(an exception that says nothing of a wrong number) or a hang is no kill. The unmutated tree passes every check first.
"""
