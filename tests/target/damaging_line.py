"""A bad serial line: runs a board's program behind a pseudo-terminal and damages bytes both ways.

Usage: damaging_line.py PROGRAM SHARE SEED. The first line printed is the port to open. Each byte is, with
probability SHARE, lost, doubled or corrupted, a third each. Killing this process is pulling the cable.
On SIGTERM it prints what it did as one line of JSON.
"""

from __future__ import annotations

import json
import os
import random
import select
import signal
import subprocess
import sys
import tty


class Damage:
    """Damages bytes at random, from a seed, and counts."""

    def __init__(self, share: float, seed: int) -> None:
        self.share, self.random = share, random.Random(seed)
        self.counts = {"bytes": 0, "lost": 0, "doubled": 0, "corrupted": 0}

    def __call__(self, data: bytes) -> bytes:
        out = bytearray()
        self.counts["bytes"] += len(data)
        for byte in data:
            if self.random.random() >= self.share:
                out.append(byte)
                continue
            kind = self.random.choice(("lost", "doubled", "corrupted"))
            self.counts[kind] += 1
            if kind == "doubled":
                out += bytes([byte, byte])
            elif kind == "corrupted":
                out.append(byte ^ self.random.randrange(1, 256))
        return bytes(out)


def main() -> None:
    program, share, seed = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    host, far = os.openpty()
    tty.setraw(far)  # stays open: before the host opens the port there is an end to it
    print(os.ttyname(far), flush=True)
    board = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert board.stdin is not None
    assert board.stdout is not None
    to_board, from_board = board.stdin.fileno(), board.stdout.fileno()
    damage = Damage(share, seed)

    def stop(*_: object) -> None:
        print(json.dumps(damage.counts), flush=True)
        board.kill()
        os._exit(0)

    signal.signal(signal.SIGTERM, stop)
    while True:
        ready, _, _ = select.select([host, from_board], [], [])
        for source, target in ((host, to_board), (from_board, host)):
            if source in ready:
                os.write(target, damage(os.read(source, 4096)))


if __name__ == "__main__":
    main()
