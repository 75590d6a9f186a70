"""A process of ours for code that may crash or hang: it makes an estimator and answers calls of its methods.

Requests and answers are pickled, each after its length; the process that asks is the one that started this one.
"""

from __future__ import annotations

import os
import pickle
import struct
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.adapters.child import Child, ChildEnded, ChildHung, blamed
from truemean.errors import SubjectError, TruemeanError, raised

__all__ = ["Host", "main"]

HEAD = struct.Struct("<Q")
MOST = 1 << 40  # bytes of an answer
# The paths of this process come last: what it has imported may have put some in front, as Blender does.
START = "import sys; sys.path += [p for p in {path!r} if p not in sys.path]; from truemean.adapters.host import main; main()"


class Host:
    """``factory(*arguments)``, a dotted name, in a process of its own: `call` runs a method there.

    The process is started when it is first called, and again after it died.
    """

    def __init__(self, factory: str, arguments: tuple[Any, ...], timeout: float, total: float | None = None) -> None:
        self.made = pickle.dumps((factory, arguments))
        self.child = Child([sys.executable, "-P", "-c", START.format(path=sys.path)], timeout, total)

    def call(self, method: str, *arguments: Any, timeout: float = 0.0) -> Any:
        """What the method returns or raises; ChildEnded or ChildHung where the process dies of it."""
        if not self.child.running:
            self._make()
        return self._ask(pickle.dumps((method, arguments)), timeout)

    def replicates(self, method: str, seeds: NDArray[np.int64], *before: Any) -> Any:
        """The same for ``method(*before, seeds)``; SubjectError with the seed at which it dies."""
        try:
            return self.call(method, *before, seeds)
        except (ChildEnded, ChildHung) as error:
            raise blamed(
                self.child, lambda some, seconds: self.call(method, *before, some, timeout=seconds), seeds, error
            ) from error

    def _make(self) -> None:
        try:
            self._ask(self.made, 0.0)
        except (ChildEnded, ChildHung) as error:  # no seed is to blame
            raise SubjectError(f"{error}, when it was loaded") from None
        except TruemeanError:
            self.child.stop()  # it waits to be told again what to make
            raise

    def _ask(self, message: bytes, timeout: float) -> Any:
        answer = self.child.ask(HEAD.pack(len(message)) + message, _is_whole, MOST, timeout)
        good, found = pickle.loads(memoryview(answer)[HEAD.size :])  # noqa: S301 - of our own process
        if not good:
            raise found
        return found


def _is_whole(answer: bytearray) -> bool:
    return len(answer) >= HEAD.size and len(answer) >= HEAD.size + HEAD.unpack_from(answer)[0]


def main() -> None:
    """Answer until the process that asks is gone; what the code prints goes to standard error."""
    source, target = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    made: Any = None
    while head := source.read(HEAD.size):
        name, arguments = pickle.loads(source.read(HEAD.unpack(head)[0]))  # noqa: S301 - of the process that started us
        # The first request makes the estimator, each other one calls a method of it.
        good, found = _tried(
            _make if made is None else getattr(made, name), *([name] if made is None else []), *arguments
        )
        if made is None and good:
            made, found = found, None
        answer = pickle.dumps((good, found))
        target.write(HEAD.pack(len(answer)) + answer)
        target.flush()


def _make(factory: str, *arguments: Any) -> Any:
    from truemean.adapters.registry import resolve

    return resolve(factory)(*arguments)


def _tried(call: Callable[..., Any], *arguments: Any) -> tuple[bool, Any]:
    """Whether it went well, and what it gave or raised."""
    try:
        return True, call(*arguments)
    except TruemeanError as error:
        return False, error
    except (Exception, SystemExit) as crash:  # noqa: BLE001 - whatever it is, it is told to who asks
        return False, SubjectError(f"crashed with {raised(crash)}")
