"""truemean: what a sampling plan is worth exactly, and whether an estimator has the true mean."""

import os.path

__version__ = "0.1.0"

_here = os.path.dirname(__file__)  # not pathlib, whose import would cost more than all the rest
if not os.path.isdir(os.path.join(_here, "oracle")):  # a checkout without links
    __path__.append(os.path.dirname(os.path.dirname(_here)))
