"""truemean: what a sampling plan is worth exactly, and whether an estimator has the true mean."""

from pathlib import Path

__version__ = "0.1.0"

if not (Path(__file__).parent / "oracle").is_dir():  # a checkout without links
    __path__.append(str(Path(__file__).parents[2]))
