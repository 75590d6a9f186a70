"""``truemean`` called in this process, in a directory that holds subjects and plans of a reader's own."""

import sys

from typer.testing import CliRunner

from truemean.cli import app

SUBJECTS = """
import sys, time
from pathlib import Path
import numpy as np

print("noise of the subject")

def exact(pixel, seeds):
    values, weights = pixel.arrays()
    return np.array([weights @ values for _ in seeds])

def shifted(pixel, seeds):
    return exact(pixel, seeds) + 0.25

exact.deterministic = shifted.deterministic = True

def noisy(pixel, seeds):
    return np.array([np.random.default_rng(seed).random() < exact(pixel, [0])[0] for seed in seeds], dtype=float)

def nan(pixel, seeds):
    return np.full(len(seeds), np.nan)

def patient(pixel, seeds):
    Path("started").touch()
    time.sleep(0.05)
    return noisy(pixel, seeds)

class Broken:
    def __init__(self):
        raise RuntimeError("no device")
"""
PLANS = """
def reaches(X, n=4):
    print("noise of the plan")
    return [X.draw(n)][n]

def walk(X, n=30):
    S = X.draw(2)
    while S.size < n and S.range() <= 0:
        S.more(1)
    return S.mean()
"""


def directory(path, monkeypatch):
    """``path``, made the current directory and filled with modules that are forgotten afterwards."""
    (path / "subjects_of_cli.py").write_text(SUBJECTS)
    (path / "plans_of_cli.py").write_text(PLANS)
    monkeypatch.chdir(path)
    monkeypatch.setattr("sys.path", [*sys.path])
    monkeypatch.setattr("tempfile.tempdir", str(path))
    yield path
    sys.modules.pop("subjects_of_cli", None)


def call(*arguments):
    """Exit code, standard output and standard error of ``truemean *arguments``."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments], env={"COLUMNS": "120"})
    assert done.exception is None or isinstance(done.exception, SystemExit)
    return done.exit_code, done.stdout, done.stderr
