"""Exit codes: what each means, and the one line on standard error that goes with it."""

from __future__ import annotations

import platform
import sys
import tempfile
import traceback
from collections.abc import Callable

import truemean
from truemean.errors import SubjectError, TruemeanError

__all__ = ["BROKEN", "CODES", "exit_code", "judged_code"]

WRONG_USE, BROKEN, INTERNAL, INTERRUPTED = 2, 4, 70, 130
VERDICTS = {"CONFORMS": 0, "BIASED": 1, "INCONCLUSIVE": 3, "BROKEN": BROKEN}
CODES = (
    "Exit codes: 0 done, and for judge: CONFORMS everywhere; 1 BIASED or DEVIATES; 2 wrong use; 3 INCONCLUSIVE; "
    "4 the subject is BROKEN; 70 a fault of truemean; 130 interrupted."
)


def exit_code(run: Callable[[], int]) -> int:
    """What ``run`` returns; whatever it raises becomes a line on standard error and its code."""
    try:
        return run()
    except SubjectError as error:
        return _told(BROKEN, f"the subject is broken: {error}")
    except TruemeanError as error:
        return _told(WRONG_USE, str(error))
    except KeyboardInterrupt:
        return _told(INTERRUPTED, "interrupted")
    except Exception as error:  # noqa: BLE001 - a fault of ours is told in one line too
        return _told(INTERNAL, f"internal error, {type(error).__name__}: {error}; {_saved_traceback()}")


def judged_code(verdict: str, *, deviates: bool, interrupted: bool) -> int:
    """The code of a judgement.

    >>> judged_code("CONFORMS", deviates=True, interrupted=False)
    1
    """
    if interrupted:
        return _told(INTERRUPTED, "interrupted; this is the evidence so far")
    code = VERDICTS[verdict]
    return VERDICTS["BIASED"] if deviates and code != BROKEN else code


def _told(code: int, line: str) -> int:
    print(f"truemean: {line}", file=sys.stderr)  # noqa: T201 - this is what it is for
    return code


def _saved_traceback() -> str:
    version = f"truemean {truemean.__version__}, Python {platform.python_version()}"
    text = "\n".join([version, repr(sys.argv), traceback.format_exc()])
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="truemean-error-", suffix=".txt", encoding="utf-8", delete=False
        ) as file:
            file.write(text)
    except OSError:
        return "its traceback could not be saved"
    return f"please report it with {file.name}, which holds the traceback"
