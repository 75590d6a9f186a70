"""The page in a browser without a network: no complaint, and something to see, in light, dark and on a phone."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np
import pytest
from matplotlib.image import imread

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
LOOKS = {
    "light": ("1200,2400", "--blink-settings=preferredColorScheme=1"),
    "dark": ("1200,2400", "--blink-settings=preferredColorScheme=0"),
    "phone": ("500,2400", "--blink-settings=preferredColorScheme=1"),
}


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="chromium is not installed: apt-get install chromium")
@pytest.mark.parametrize("look", LOOKS)
def test_the_page_in_a_browser(look, built, tmp_path):
    size, colours = LOOKS[look]
    shot = tmp_path / "shot.png"
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr"]
    offline = ["--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}"]
    page = (built.folder / "report.html").as_uri()
    done = subprocess.run(
        [BROWSER, *options, *offline, colours, f"--window-size={size}", f"--screenshot={shot}", page],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert re.findall(r".*CONSOLE.*", done.stderr) == []
    seen = imread(shot)[..., :3]
    assert seen.shape[:2] == tuple(map(int, size.split(",")))[::-1]
    assert len(np.unique(seen.reshape(-1, 3), axis=0)) > 50
    assert (seen[0, 0].mean() < 0.5) == (look == "dark")
