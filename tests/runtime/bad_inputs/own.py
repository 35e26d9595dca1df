"""Bad inputs, command by command: the words behind it, and a part of the line that refuses them.

They are read as a shell reads them, in the folder that :mod:`tests.runtime.bad_inputs.place` fills.
"""

from __future__ import annotations

import shlex

#: What each command has of its own.
OWN = {
    "run": """
        --al | No such option
        --build a_file | is a file, not a folder
        paper_spmsm paper_again.toml | two drives are called
        tight.toml good.toml nothing | no drive 'nothing'
        """,
    "new": """
        BIG | small letter
        1st | small letter
        a-b | small letter
        '' | NAME is empty
        '[/b]' | small letter
        motor | answers end before the facts are whole
        motor --draws 0 | --draws
        motor --seed -1 | --seed
        motor --facts-out a_folder/x.txt | ends in .toml
        motor --out none/x.toml | is not there
        motor --facts-out m.toml --out m.toml | both write
        """,
    "doctor": """
        everything | unexpected extra argument
        --json a_folder | is a folder
        --json none/d.json | is not there
        """,
    "design": """
        nothing.toml --check | cannot be read
        a_folder --check | cannot be read
        a_file --check | not valid TOML
        folder.toml --check | cannot be read
        binary.toml --check | UTF-8
        empty.toml --check | missing
        eio.toml --check | cannot be read
        good.toml --check | unknown key
        facts_odd.toml --check | [/b]
        paper_spmsm --check | cannot be read
        facts.toml | say where the drive file goes
        facts.toml --check --out d.toml | --check writes nothing
        facts.toml --check --write good.toml | --check writes nothing
        facts.toml --out d.txt | ends in .toml
        facts.toml --out facts.toml | would write over 'facts.toml'
        facts.toml --out none/d.toml | is not there
        facts.toml --write a_file | ends in .toml
        facts.toml --write nothing.toml | nothing.toml
        facts.toml --write folder.toml | folder
        facts.toml --write broken.toml | broken.toml
        facts.toml --write binary.toml | binary.toml
        facts.toml --check --draws 7 | --draws
        facts.toml --check --draws 1e3 | --draws
        facts.toml --out d.toml --json d.toml | both write
        facts.toml --out d.toml --write good.toml --json good.toml | would write over
        facts.toml facts.toml --check | unexpected extra argument
        """,
    "generate": """
        --form slow | no form 'slow'; there are: fast, literal
        --form literal | --out DIR
        --form fst --out o | Did you mean 'fast'?
        --target c28x | --out DIR
        --target f2833 --out o | Did you mean 'f28335'?
        --target '[/b]' --out o | no target '[/b]'
        paper_again.toml paper_spmsm --out o | two drives are called
        paper_spmsm nothing --out o | no drive 'nothing'
        paper_spmsm --out a_file | is a file, not a folder
        paper_spmsm --out a_file/x | is a file, not a folder
        paper_spmsm --out dangling.toml | a link to nothing
        paper_spmsm --out /proc/x | cannot be written to
        """,
    "package": """
        paper_spmsm --out p | Missing option '--for'
        paper_spmsm --for cmake | Missing option '--out'
        paper_spmsm --for cmak --out p | cmake
        paper_spmsm --for '' --out p | --for
        paper_spmsm --for cmake --out a_file | is a file
        paper_spmsm --for cmake --out a_folder --filter pf | has no filter 'pf'
        paper_spmsm --for cmake --out edited | edited
        lacking --for cmake --out p | cannot be read
        edited --for cmake --out p | edited by hand
        good.toml --for cmake --out p | not generated yet
        """,
    "page": """
        paper_spmsm | Missing option '--out'
        --out p | Missing argument 'DRIVE'
        paper_spmsm ipmsm --out p | unexpected extra argument
        paper_spmsm --out p --filter pf | has no filter 'pf'
        paper_spmsm --out p --filter ikf | Did you mean 'ickf'?
        paper_spmsm --out p --filter '' | --filter is empty
        paper_spmsm --out a_file | is a file
        paper_spmsm --out a_file/x | is a file
        paper_spmsm --out dangling.toml | a link to nothing
        good.toml --out p | not generated yet
        edited --out p | edited by hand
        lacking --out p | cannot be read
        """,
    "export fmu": """
        paper_spmsm | Missing option '--out'
        paper_spmsm --out o.fmu --fmi 1 | --fmi
        paper_spmsm --out o.fmu --fmi 2.5 | --fmi
        paper_spmsm --out o.fmu --part motr | motor
        paper_spmsm --out o.fmu --filter ekf | has no filter 'ekf'
        lacking --out o.fmu | cannot be read
        edited --out o.fmu | edited by hand
        paper_spmsm --out a_folder | is a folder
        """,
    "export sfunction": """
        paper_spmsm --out 1.c | not the name of an S-function
        paper_spmsm --out a-b.c | not the name of an S-function
        paper_spmsm --out '[b].c' | not the name of an S-function
        paper_spmsm --out o.c --part all | filter
        edited --out o.c | edited by hand
        """,
    "export plecs": """
        paper_spmsm --out none/o.h | is not there
        paper_spmsm --out o.h --filter '' | --filter is empty
        renamed --out o.h | cannot be read
        """,
    "export a2l": """
        paper_spmsm --out o.a2l --address x | not an address
        paper_spmsm --out o.a2l --address -1 | not an address
        paper_spmsm --out o.a2l --address 0xfffffffffffffffff | not an address
        paper_spmsm --out o.a2l --symbol 1x | not the name of a variable
        paper_spmsm --out o.a2l --symbol '' | --symbol is empty
        paper_spmsm --out o.a2l --symbol '[/b]' | not the name of a variable
        paper_spmsm --out o.a2l --data-model c2000 | c28x
        """,
    "verify": """
        paper_spmsm nothing | no drive 'nothing'
        good.toml | not generated yet
        edited | edited by hand
        lacking | lacking
        renamed | renamed
        --json a_folder | is a folder
        --jsn x | No such option
        """,
    "firmware": """
        good.toml | not generated yet
        edited | edited by hand
        lacking | lacking
        renamed | renamed
        --json none/f.json | is not there
        """,
    "simulate": """
        --scenario dance | no scenario 'dance'; there are: no_load, load_step
        --scenario load_stp | Did you mean 'load_step'?
        --scenario '' | --scenario is empty
        --filters ckf,pf | no filter 'pf'; there are: ckf, ickf, ekf, ukf
        --filters '' | --filters is empty
        --filters ckf,ckf | twice
        --filters , | no filter ''
        --inverter magic | no inverter 'magic'
        --controller rust | no controller 'rust'; there are: c, numpy
        --delay 2 | --delay
        --bits 25 | --bits
        --bits 1.5 | --bits
        --seed -1 | --seed
        --noise -1 | --noise
        --noise nan | --noise nan is not a finite number
        --dead-time 1 | --dead-time
        --speed 1e30 | --speed
        --ramp 0 | --ramp
        --ramp -1 | --ramp
        --theta 1e30 | --theta
        --min-pulse -1 | --min-pulse
        --min-pulse 1 | --min-pulse
        --offset inf | --offset
        --factors R | not NAME=FACTOR
        --factors R=0 | --factors
        --factors Q=1 | no --factors 'Q'
        --factors R=1,R=2 | R twice
        --factors L_d=2 | one inductance
        paper_spmsm ipmsm | unexpected extra argument
        --json a_file/x.json | is a file
        --json good.toml good.toml | would write over 'good.toml'
        --out a_file | is a file
        edited | edited by hand
        """,
    "replay": """
        paper_spmsm | Missing argument 'DATA'
        paper_spmsm good.npz --filter pf | has no filter 'pf'
        paper_spmsm good.npz --backend rust | backend
        paper_spmsm good.npz --dtype float16 | dtype
        paper_spmsm good.npz --x0 1,2 | x0
        paper_spmsm good.npz --x0 a,b,c,d | not a number
        paper_spmsm good.npz --x0 nan,0,0,0 | not a finite number
        paper_spmsm good.npz --x0 0,0,0,0 --theta0 1 | theta0
        paper_spmsm good.npz --theta0 1e9 | --theta0
        paper_spmsm good.npz --rename t | --rename
        paper_spmsm good.npz --rename x=t | x
        paper_spmsm good.npz --rename t=zeit | zeit
        paper_spmsm good.npz --rename '[/b]=t' | [/b]
        paper_spmsm good.npz --scale t | --scale
        paper_spmsm good.npz --scale t=0 | --scale
        paper_spmsm good.npz --scale t=inf | --scale
        paper_spmsm good.npz --scale t=1e300 | --scale
        paper_spmsm good.npz --scale i_alpha=V | --scale
        paper_spmsm good.npz --offset i_alpha | --offset
        paper_spmsm good.npz --offset i_alpha=1e300 | --offset
        paper_spmsm good.npz --offset i_alpha=x | --offset
        paper_spmsm good.npz --offset q=1 | q
        paper_spmsm good.npz --wiring abd | --wiring
        paper_spmsm good.npz --wiring '' | --wiring is empty
        paper_spmsm good.npz --dc-link -1 | --dc-link
        paper_spmsm good.npz --out est.csv | .npz
        paper_spmsm good.npz --out good.npz | would write over 'good.npz'
        paper_spmsm good.npz --json good.npz | would write over 'good.npz'
        paper_spmsm good.npz --plots a_file | is a file
        paper_spmsm good.npz --out e.npz --json ./e.npz | both write
        edited good.npz | edited by hand
        good.toml good.npz | not generated yet
        """,
    "compare": """
        paper_spmsm nothing | no drive 'nothing'
        good.toml paper_spmsm | not generated yet
        edited paper_spmsm | edited by hand
        renamed paper_spmsm | cannot be read
        paper_spmsm ipmsm --out a_file | is a file
        paper_spmsm paper_spmsm | twice
        """,
    "identify": """
        paper_spmsm | Missing argument 'DATA...'
        paper_spmsm good.npz --free '' | --free is empty
        paper_spmsm good.npz --free , | --free names nothing
        paper_spmsm good.npz --free R,Q | --free Q: no such datum
        paper_spmsm good.npz --free R,R | twice
        paper_spmsm good.npz --free L_d | one inductance
        ipmsm good.npz --free L | two inductances
        paper_spmsm good.npz nothing.npz | nothing.npz
        paper_spmsm good.npz --write w.txt | ends in .toml
        paper_spmsm good.npz --write none/w.toml | is not there
        paper_spmsm good.npz --write binary.toml | not valid TOML
        paper_spmsm good.npz --write folder.toml | folder.toml
        paper_spmsm good.npz --write eio.toml | eio.toml
        paper_spmsm good.npz --wiring xyz | --wiring
        paper_spmsm good.npz --json good.npz | would write over
        facts_odd.toml good.npz | [/b]
        """,
    "study run": """
        paper_spmsm --runs 0 | --runs
        paper_spmsm --runs 1e3 | --runs
        paper_spmsm --filters pf | no filter 'pf'
        paper_spmsm --scenario dance | no scenario 'dance'
        paper_spmsm --vary R | not NAME=LOW:HIGH
        paper_spmsm --vary R=2:1 | is more than
        paper_spmsm --vary R=-1:1 | cannot be below
        paper_spmsm --vary R=1:2:lag | not a number
        paper_spmsm --vary noise=0:1:log | begins above 0
        paper_spmsm --vary R=1 --vary R=2 | given twice
        paper_spmsm --vary L=1 --vary L_d=1 | leave it out
        paper_spmsm --vary L_d=2 | one inductance
        paper_spmsm --vary Rs=1 | Did you mean 'R'?
        paper_spmsm --vary R=1:rated | no rated R
        paper_spmsm --vary theta=nan | not a finite number
        paper_spmsm --vary '' | --vary is empty
        paper_spmsm --out a_file | is a file
        paper_spmsm --seed 99999999999999999999 | --seed
        """,
    "study tune": """
        paper_spmsm --filter pf | filter
        paper_spmsm --trials 0 | --trials
        paper_spmsm --vary Q=1 | nothing called 'Q' varies
        paper_spmsm --out a_file | is a file
        paper_spmsm ipmsm | unexpected extra argument
        """,
    "study map": """
        paper_spmsm --filter pf | filter
        paper_spmsm --runs -1 | --runs
        paper_spmsm --out a_file/x | is a file
        """,
    "pil": """
        paper_spmsm | Missing option '--port'
        --port '' | --port is empty
        --port nothing | cannot open port 'nothing'
        --port a_file | cannot open port 'a_file'
        --port a_folder | cannot open port 'a_folder'
        --port /dev/null | /dev/null
        --port '[/b]' | [/b]
        --port simulated --baud 0 | --baud
        --port simulated --baud 99999999999999 | --baud
        --port simulated --steps 0 | --steps
        --port simulated --attempts 0 | --attempts
        --port simulated --timeout 0 | --timeout
        --port simulated --ticks-hz 0 | --ticks-hz
        --port simulated --tolerance bit | Did you mean 'bits'?
        --port simulated --mode fre | Did you mean 'free'?
        --port simulated --mode free --tolerance certificate | --mode single
        --port simulated --backend rust | backend
        --port simulated --filter ekf | filter
        --port simulated paper_spmsm --filter pf | filter
        --port simulated --data nothing.npz | nothing.npz
        --port simulated --data a_folder | a_folder
        --port simulated --json a_folder | is a folder
        """,
    "record": """
        paper_spmsm | Missing option '--port'
        --port nothing | cannot open port 'nothing'
        --port a_file --out r.npz | cannot open port 'a_file'
        --port simulated --out r.txt | .npz or .csv
        --port simulated --out good.npz | exists
        --port simulated --out a_folder | is a folder
        --port simulated --out none/r.npz | is not there
        --port simulated --seconds 0 | --seconds
        --port simulated --seconds nan | --seconds
        --port simulated --baud x | --baud
        """,
    "commission": """
        --port simulated | Missing option '--facts'
        --facts facts.toml | Missing option '--port'
        --port simulated --facts nothing.toml | cannot be read
        --port simulated --facts good.toml | unknown key
        --port nothing --facts facts.toml --yes | cannot open port 'nothing'
        --port nothing --facts facts.toml --motor facts.toml | --port simulated
        --port simulated --facts facts.toml --motor nothing.toml | cannot be read
        --port simulated --facts facts.toml --max-current 1e4 | beyond rated.max_current
        --port simulated --facts facts.toml --max-current nan | --max-current
        --port simulated --facts facts.toml --max-speed 1e5 | beyond the rated speed
        --port simulated --facts facts.toml --out r.csv | .npz
        --port simulated --facts facts.toml --out good.npz | exists
        --port simulated --facts facts.toml --drive d.txt | ends in .toml
        --port simulated --facts facts.toml --drive good.toml | exists
        --port simulated --facts facts.toml --write w.txt | ends in .toml
        --port simulated --facts facts.toml --write binary.toml | not valid TOML
        --port simulated --facts facts.toml --json facts.toml | would write over
        """,
    "starts": """
        paper_spmsm --filters pf | filter 'pf'
        paper_spmsm --filters '' | --filters is empty
        paper_spmsm --runs 0 | --runs
        good.toml | not generated yet
        edited | edited by hand
        """,
    "faults": """
        paper_spmsm --only dance | no fault 'dance'
        paper_spmsm --only '' | --only is empty
        paper_spmsm --only swaped | Did you mean 'swapped'?
        paper_spmsm --filters pf | filter 'pf'
        paper_spmsm --seeds 0 | --seeds
        paper_spmsm --speed nan | --speed
        paper_spmsm --load 1e300 | --load
        paper_spmsm --out a_file | is a file
        good.toml | not generated yet
        """,
    "fuzz": """
        paper_spmsm --executions 0 | --executions
        paper_spmsm --corpus a_file | is a file
        good.toml | not generated yet
        edited | edited by hand
        """,
    "soak": """
        paper_spmsm --filter pf | filter 'pf'
        paper_spmsm --steps 0 | --steps
        paper_spmsm --steps 1.5 | --steps
        paper_spmsm --plots a_file | is a file
        good.toml | not generated yet
        """,
}  # fmt: skip


#: Those that take seconds until they are refused.
SLOW = {
    "study run": """
        paper_spmsm --scheduler nonsense | scheduler
        paper_spmsm --scheduler tcp://127.0.0.1:1 | scheduler
        """,
    "verify": "no_filters | no_filters",
    "study tune": "paper_spmsm --vary L_d=2 | one inductance",
}


def own_cases(blocks: dict[str, str]) -> list[tuple[str, list[str], str]]:
    """Command, words behind it, and what is said."""
    found = []
    for command, block in blocks.items():
        for line in filter(None, map(str.strip, block.splitlines())):
            words, _, said = line.rpartition(" | ")
            found.append((command, shlex.split(words), said))
    return found
