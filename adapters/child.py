"""A program that runs beside us, is asked on its standard input and answers on its standard output.

Time and output are limited, what it writes to standard error is kept, and it is started again after it ended.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import subprocess
import time
import weakref
from collections.abc import Callable, Sequence
from typing import Any

from truemean.errors import InputError, SubjectError

__all__ = ["Child", "ChildEnded", "ChildHung", "blamed", "read_seconds"]

PIPE, TAIL = 1 << 20, 2000  # bytes of a pipe, and of standard error that are kept
SHORT = 2.0  # seconds that a part of a batch has at least


class ChildEnded(SubjectError):
    """The program ended, or said what it must not, while it was asked."""


class ChildHung(SubjectError):
    """The program did not answer in time."""


class Child:
    """A program by its command line, started at the first `ask` and again after it ended.

    ``timeout`` seconds are allowed for an answer, ``total`` for all of them together.
    """

    def __init__(self, command: Sequence[str], timeout: float, total: float | None = None) -> None:
        self.command, self.timeout, self.total, self.left = list(command), timeout, total, total
        self.starts, self.interrupted = 0, False
        self._process: subprocess.Popen[bytes] | None = None
        self._tail = bytearray()
        self._kill: Callable[[], Any] = lambda: None

    @property
    def running(self) -> bool:
        """Whether it is there and can be asked."""
        return self._process is not None

    def start(self) -> None:
        """Start it; InputError where there is no such program, SubjectError while it is interrupted."""
        if self.interrupted:
            raise SubjectError("is interrupted")
        try:
            process = subprocess.Popen(  # noqa: S603 - the reader's own command, without a shell
                self.command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            raise InputError(f"{self.command[0]!r} can't be started ({error}): give the path of a program") from None
        for stream in (process.stdin, process.stdout, process.stderr):
            os.set_blocking(stream.fileno(), False)  # type: ignore[union-attr] # all three are pipes
            _enlarge(stream)
        self._process, self._tail = process, bytearray()
        self._kill = weakref.finalize(self, _kill, process)
        self.starts += 1

    def stop(self) -> None:
        """End it, with everything that it has started."""
        self._kill()
        self._process = None

    def interrupt(self) -> None:
        """From another thread: end what it does, and start it no more until `resume` is called."""
        self.interrupted, process = True, self._process
        if process is not None:
            _signal(process)

    def resume(self) -> None:
        """After an interrupt: let it be started again."""
        if self.interrupted:
            self.stop()
            self.interrupted = False

    def ask(self, message: bytes, whole: Callable[[bytearray], bool], limit: int, timeout: float = 0.0) -> bytearray:
        """Send ``message`` and read until the answer is ``whole``, ``limit`` bytes at most.

        Raises ChildHung after ``timeout`` seconds, ChildEnded when the program ends or says too much, SubjectError when it
        speaks unasked or ``total`` is used up; it is stopped then.
        """
        allowed, begun = timeout or self.timeout, time.monotonic()
        answer = bytearray()
        try:
            if self._process is None:
                self.start()
            else:
                self._listen(self._process)
            self._exchange(memoryview(message), answer, whole, limit, allowed)
        except BaseException:  # an interrupt too: what the program says later would be taken for another answer
            self.stop()
            raise
        finally:
            if self.left is not None:
                self.left = max(0.0, self.left - (time.monotonic() - begun))
        return answer

    def _exchange(
        self, message: memoryview, answer: bytearray, whole: Callable[[bytearray], bool], limit: int, allowed: float
    ) -> None:
        """Write and read at once, as either side's pipe may be full."""
        process: Any = self._process
        deadline = time.monotonic() + (allowed if self.left is None else min(allowed, self.left))
        with selectors.DefaultSelector() as waiting:
            waiting.register(process.stdin, selectors.EVENT_WRITE)
            waiting.register(process.stdout, selectors.EVENT_READ)
            waiting.register(process.stderr, selectors.EVENT_READ)
            while message or not whole(answer):
                left = deadline - time.monotonic()
                ready = waiting.select(left) if left > 0 else []
                if not ready:
                    raise self._late(allowed, answer)
                for key, _ in ready:
                    if key.fileobj is process.stdin:
                        message = message[self._write(process, message) :]
                        if not message:
                            waiting.unregister(process.stdin)
                    elif key.fileobj is process.stderr:
                        if not self._keep(process):
                            waiting.unregister(process.stderr)
                    else:
                        self._read(process, answer, limit)

    def _write(self, process: Any, message: memoryview) -> int:
        try:
            written: int = os.write(process.stdin.fileno(), message[:PIPE])
        except BrokenPipeError:  # its answer, or its end, is read next
            return len(message)
        return written

    def _read(self, process: Any, answer: bytearray, limit: int) -> None:
        got = os.read(process.stdout.fileno(), PIPE)
        if not got:
            raise ChildEnded(f"{self._ending(process)}{self._told(answer)}")
        answer += got
        if len(answer) > limit:
            raise ChildEnded(f"printed more than was asked, {len(answer)} bytes and on{self._told(answer)}")

    def _keep(self, process: Any) -> bool:
        got = os.read(process.stderr.fileno(), PIPE)
        self._tail = (self._tail + got)[-TAIL:]
        return bool(got)

    def _listen(self, process: Any) -> None:
        """It must be there, and silent, before it is asked."""
        with contextlib.suppress(BlockingIOError):
            if said := os.read(process.stdout.fileno(), PIPE):
                raise SubjectError(f"printed what was not asked for, {said[:60].decode(errors='replace')!r}")
            raise ChildEnded(f"{self._ending(process)}{self._told(bytearray())}")

    def _late(self, allowed: float, answer: bytearray) -> SubjectError:
        if self.left is not None and self.left < allowed:
            return SubjectError(f"has used up the {self.total:g} s of total={self.total:g}{self._told(answer)}")
        return ChildHung(f"did not answer within {allowed:g} s{self._told(answer)}")

    def _ending(self, process: Any) -> str:
        """How it ended, once the rest of its standard error has been read."""
        try:
            code = process.wait(timeout=0.5)
        except subprocess.TimeoutExpired:
            return "closed its standard output"
        with contextlib.suppress(OSError):
            while self._keep(process):
                pass
        if code >= 0:
            return f"ended with exit code {code}"
        named = -code in {*signal.Signals}
        return f"was killed by signal {signal.Signals(-code).name if named else -code}"

    def _told(self, answer: bytearray) -> str:
        """The last words of both of its outputs."""
        said = bytes(answer[-60:]).decode(errors="replace").strip()
        errors = self._tail.decode(errors="replace").strip()
        parts = [
            f", its answer so far ending {said!r}" if said else "",
            f"; standard error: {errors}" if errors else "",
        ]
        return "".join(parts)


def blamed(child: Child, run: Callable[[Any, float], Any], seeds: Any, error: SubjectError) -> SubjectError:
    """The error of the one seed at which ``child`` breaks, found by halving; ``error`` where it breaks at none alone.

    ``run(seeds, timeout)`` asks it again. A part of a batch that hung has as large a part of its time.
    """
    tried, whole, least = seeds, child.timeout, min(SHORT, child.timeout / 2)
    try:
        while len(tried) > 1:
            half = len(tried) // 2
            seconds = max(least, whole * half / len(seeds)) if isinstance(error, ChildHung) else whole
            tried = tried[:half] if _breaks(run, tried[:half], seconds) else tried[half:]
        child.stop()  # what it did before is no fault of this seed
        again = _breaks(run, tried, whole)
    except SubjectError:  # nothing is to be found out any more
        return SubjectError(f"{error}; it was given {len(seeds)} seeds")
    if again:
        return SubjectError(f"at seed {int(tried[0])} it {again}")
    if len(seeds) == 1:
        return SubjectError(f"at seed {int(tried[0])}, and not when it was asked again, it {error}")
    return SubjectError(f"once in {len(seeds)} seeds, and not again at any of them alone, it {error}")


def _breaks(run: Callable[[Any, float], Any], seeds: Any, seconds: float) -> SubjectError | None:
    try:
        run(seeds, seconds)
    except (ChildEnded, ChildHung) as error:
        return error
    return None


def read_seconds(name: str, value: Any) -> float:
    """A time limit; InputError unless it is a positive number of seconds.

    >>> read_seconds("timeout", "2.5")
    2.5
    """
    try:
        seconds = float(value)
    except (TypeError, ValueError):
        seconds = 0.0
    if not 0 < seconds < float("inf"):
        raise InputError(f"{name}={value!r} is no time limit: give a positive number of seconds")
    return seconds


def _enlarge(stream: Any) -> None:
    import fcntl

    with contextlib.suppress(OSError, AttributeError):  # Linux only, and not beyond a user's quota
        fcntl.fcntl(stream.fileno(), fcntl.F_SETPIPE_SZ, PIPE)


def _signal(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


def _kill(process: subprocess.Popen[bytes]) -> None:
    _signal(process)
    process.wait()
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            stream.close()
