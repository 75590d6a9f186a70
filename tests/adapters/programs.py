"""Programs in Python that speak the protocol: an honest one, and what a test changes of it."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

HONEST = """
import os, random, signal, struct, subprocess, sys, time

def say(text):
    print(text, flush=True)

def draw():
    say("draw 1")
    return values[int(read())]

def greet():
    say("truemean 1")

def pixel():
    say("ok")

def estimate(seed):
    return sum(random.Random(seed).choices(values, weights, k=4)) / 4

def batch(seeds):
    for seed in seeds:
        sys.stdout.write(f"{estimate(seed)}\\n")
    sys.stdout.flush()

def ask():
    return (draw() + draw()) / 2

def read():
    return sys.stdin.buffer.readline().decode()

#CHANGES

for line in iter(read, ""):
    word, *rest = line.split()
    if word == "truemean":
        greet()
    elif word == "pixel":
        rows = [[float(number) for number in read().split()] for _ in range(int(rest[0]))]
        weights, values = [row[0] for row in rows], [row[1] for row in rows]
        pixel()
    elif word == "run":
        batch([int(read()) for _ in range(int(rest[0]))])
    elif word == "batch":
        count = int(rest[0])
        batch(struct.unpack(f"<{count}Q", sys.stdin.buffer.read(8 * count)))
    elif word == "ask":
        say(f"estimate {ask()}")
"""


def program(folder: Path, changes: str = "", **limits: float) -> str:
    """The subject that an honest program is with some ``changes``."""
    script = folder / "program.py"
    script.write_text(HONEST.replace("#CHANGES", changes))
    options = "&".join(f"{name}={value}" for name, value in limits.items())
    return f"exec:{shlex.join([sys.executable, '-I', str(script)])}{'?' if options else ''}{options}"
