"""One small report, built once: an honest subject, a dark one, one that breaks, one that declines."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truemean.conformance.report import build, judge_one
from truemean.errors import Unsupported

HOSTILE = "<script>alert('1|2')</script> & *stars*"


class Honest:
    """The true mean itself, on pixels of one channel."""

    declares = ("fixed", {"n": 4})

    def run(self, pixel, seeds):
        values, weights = pixel.arrays()
        if values.ndim > 1:
            raise Unsupported("no <b>colours</b> here")
        return np.array([np.random.default_rng(int(s)).choice(values, 4, p=weights).mean() for s in seeds])


class Dark:
    """A tenth of the light is lost."""

    def run(self, pixel, seeds):
        values, weights = pixel.arrays()
        return np.broadcast_to(0.9 * (weights @ values), (len(seeds), *values.shape[1:]))

    def range(self, pixel):
        return 0, 1


class Broken:
    """NaN throughout."""

    def run(self, pixel, seeds):
        return np.full((len(seeds), *pixel.arrays()[0].shape[1:]), np.nan)


@dataclass(frozen=True)
class Built:
    """What one run of `build` left."""

    folder: Path
    html: str
    markdown: str
    data: dict[str, Any]
    returned: dict[str, Any]
    told: list[tuple[str, float]]


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    told = []
    returned = build(
        folder,
        {"honest": ("own:honest?n=4", Honest()), HOSTILE: ("own:dark", Dark()), "broken": ("own:broken", Broken())},
        command="truemean report --out <here>",
        seed=3,
        skipped={"a renderer": "not installed: pip install 'truemean[renderer]'"},
        progress=lambda text, fraction: told.append((text, fraction)),
        pages={"engine": {HOSTILE + "2": judge_one("own:engine", Honest(), "5%", 3, 2000)}},
        about={"engine": "How ``it`` decides.\n\nWhat <b>was</b> found."},
    )
    html, markdown, data = ((folder / f"report.{suffix}").read_text("utf-8") for suffix in ("html", "md", "json"))
    return Built(folder, html, markdown, json.loads(data), returned, told)
