"""``exec:COMMAND``: a program in any language that speaks the line protocol of docs/protocol.md, version 1.

::

    truemean 1              the program answers  truemean 1 [costs] [binary] [asks] [seed_bits=N] [version=TEXT]
    pixel K C               K lines follow, each a weight and C channels; it answers  ok  or  unsupported REASON
    run N                   N lines follow, each a seed; it answers N lines of C estimates (and a cost)
    batch N                 N seeds follow as 64 bit integers; it answers the same numbers as 64 bit floats
    ask                     it answers  draw N  or  pick WEIGHTS  and is told indices, at last  estimate NUMBERS
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.adapters.answers import LONGEST, Answers
from truemean.adapters.child import Child, ChildEnded, ChildHung, blamed, read_seconds
from truemean.adapters.exhaustive import Asking
from truemean.errors import InputError, SubjectError, Unsupported
from truemean.subject import PixelLike

__all__ = ["Process", "load_process"]

Floats = NDArray[np.float64]
PROTOCOL = "truemean 1"
WORDS = ("costs", "binary", "asks", "seed_bits", "version")
LINE, SLACK = 64, 4096  # bytes for a number, and to spare


def load_process(
    command: str, /, timeout: Any = 60, total: Any = None, paths: Any = 300_000, order: str = "sequence"
) -> Any:
    """The estimator that a program is, or, if it asks for its samples, the exact one.

    ``timeout`` is in seconds for each answer, ``total`` for all; ``paths`` and ``order`` are those of programs that ask.
    InputError where the command can't be started, SubjectError where it does not answer the greeting.
    """
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise InputError(f"exec:{command} can't be taken apart ({error}): quote it as for a POSIX shell") from None
    if not words:
        raise InputError("exec: names no program: write exec:./my_estimator")
    limits = read_seconds("timeout", timeout), None if total is None else read_seconds("total", total)
    process = Process(Child(words, *limits))
    if not process.asks:
        return process
    asking = Asking(process.replay, name=command, paths=paths, order=order)
    asking.versions, asking.program = process.versions, process  # type: ignore[attr-defined] # seen by the judge
    return asking


class Process:
    """A program that is given a pixel and seeds, and prints estimates."""

    def __init__(self, child: Child) -> None:
        self.child = child
        self.name = shlex.join(child.command)
        self._pixel: PixelLike | None = None
        self._last: tuple[Any, ...] = ()
        self._greet()

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]``; SubjectError with the seed at which the program breaks."""
        return self._run(pixel, np.asarray(seeds, dtype=np.int64))[0]

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats | None:
        """Samples drawn ``[seeds]``, None where the program does not say."""
        return self._run(pixel, np.asarray(seeds, dtype=np.int64))[1]

    def _run(self, pixel: PixelLike, seeds: NDArray[np.int64]) -> tuple[Floats, Floats | None]:
        if not (self._last and self._last[0] is pixel and np.array_equal(self._last[1], seeds)):
            try:
                numbers = self._numbers(pixel, seeds)
            except (ChildEnded, ChildHung) as error:
                raise blamed(
                    self.child, lambda some, seconds: self._numbers(pixel, some, seconds), seeds, error
                ) from error
            except SubjectError:
                self.child.stop()  # what else it may say is no answer to what is asked next
                raise
            estimates = numbers[:, :-1] if self.with_costs else numbers
            shape = estimates if isinstance(pixel.values[0], tuple) else estimates[:, 0]
            self._last = (pixel, seeds, (shape, numbers[:, -1] if self.with_costs else None))
        found: tuple[Floats, Floats | None] = self._last[2]
        return found

    def _numbers(self, pixel: PixelLike, seeds: NDArray[np.int64], timeout: float = 0.0) -> Floats:
        """What is printed for each seed ``[seeds, channels (and cost)]``."""
        self._give(pixel)
        count = seeds.size
        width = _channels(pixel) + self.with_costs
        if self.binary:
            size = 8 * count * width
            message = f"batch {count}\n".encode() + seeds.astype("<u8").tobytes()
            answer = self.child.ask(message, lambda got: len(got) >= size, size, timeout)
            return np.frombuffer(answer, dtype="<f8").reshape(count, width)
        message = "\n".join([f"run {count}", *map(str, seeds.tolist()), ""]).encode()
        answer = self.child.ask(message, _Lines(count), count * width * LINE + SLACK, timeout)
        return _read_lines(answer, seeds, width)

    def replay(self, pixel: PixelLike, answers: Answers) -> Any:
        """One run of a program that asks: its requests are answered until it prints its estimate."""
        self._give(pixel)
        try:
            numbers = self._estimate(answers, lambda: answers.told(pixel), _channels(pixel))
        except BaseException:
            self.child.stop()  # it waits for an answer, and would take the next request for one
            raise
        return tuple(numbers) if isinstance(pixel.values[0], tuple) else numbers[0]

    def _estimate(self, answers: Answers, when: Callable[[], str], channels: int) -> list[float]:
        deadline = time.monotonic() + self.child.timeout
        line = self._say("ask", when)
        while not line.startswith("estimate "):
            word, *rest = line.split() or [""]
            if word == "draw" and len(rest) == 1 and rest[0].isdecimal():
                told = answers.draw(int(rest[0]))
            elif word == "pick" and rest:
                told = [answers.pick(rest)]
            else:
                raise SubjectError(f"printed {line!r:.80} {when()}: expected draw N, pick WEIGHTS or estimate NUMBERS")
            if answers.used > LONGEST and time.monotonic() > deadline:
                raise ChildHung(f"asked for {answers.used} samples and gave no estimate in {self.child.timeout:g} s")
            line = self._say(" ".join(map(str, told)), when)
        numbers = _floats(line.split()[1:])
        if len(numbers) != channels:
            raise SubjectError(f"printed {line!r:.80} {when()}: expected estimate and {channels} numbers")
        return numbers

    def _give(self, pixel: PixelLike) -> None:
        """Start the program if it is not there, and tell it which pixel is meant."""
        if not self.child.running:
            self._greet()
        if self._pixel is pixel:
            return
        values, weights = pixel.arrays()
        rows = [" ".join(map(repr, row)) for row in np.column_stack([weights, values]).tolist()]
        answer = self._say("\n".join([f"pixel {len(rows)} {_channels(pixel)}", *rows]))
        if answer.startswith("unsupported"):
            raise Unsupported(answer.removeprefix("unsupported").strip() or "the program declines this pixel")
        if answer != "ok":
            raise SubjectError(f"answered {answer!r:.80} to a pixel: expected ok, or unsupported REASON")
        self._pixel = pixel

    def _greet(self) -> None:
        self._pixel = None
        answer = self._say(PROTOCOL)
        words = answer.removeprefix(PROTOCOL).split()
        said = dict(word.partition("=")[::2] for word in words)
        if not answer.startswith(PROTOCOL) or not set(said) <= set(WORDS):
            self.child.stop()
            raise SubjectError(
                f"answered {answer!r:.80} to {PROTOCOL!r}: expected {PROTOCOL}, then any of {', '.join(WORDS)}"
            )
        self.with_costs, self.binary, self.asks = (word in said for word in WORDS[:3])
        self.versions = {self.name: said["version"]} if said.get("version") else {}
        if "seed_bits" in said:
            self.seed_bits = self._read_bits(said["seed_bits"])

    def _read_bits(self, text: str) -> int:
        if not (text.isdecimal() and 1 <= int(text) <= 63):
            self.child.stop()
            raise SubjectError(f"said seed_bits={text!r:.20}: expected a whole number from 1 to 63")
        return int(text)

    def _say(self, line: str, when: Callable[[], str] | None = None) -> str:
        """What is said sent, one line read; SubjectError, with ``when`` it was, where none comes."""
        head = line.partition("\n")[0]
        try:
            answer = self.child.ask(f"{line}\n".encode(), _Lines(1), SLACK)
        except (ChildEnded, ChildHung) as error:
            raise SubjectError(f"{error}, {when() if when else f'when told {head!r}'}") from None
        first, _, rest = answer.decode(errors="replace").partition("\n")
        if rest:
            self.child.stop()
            raise SubjectError(f"printed more than a line, {first!r:.60} and {rest!r:.60}, when told {head!r}")
        return first.strip()


class _Lines:
    """Whether so many lines have been read, looking at each byte once."""

    def __init__(self, count: int) -> None:
        self.missing, self.seen = count, 0

    def __call__(self, answer: bytearray) -> bool:
        self.missing -= answer.count(b"\n", self.seen)
        self.seen = len(answer)
        return self.missing <= 0


def _read_lines(answer: bytearray, seeds: NDArray[np.int64], width: int) -> Floats:
    """The numbers of each line; SubjectError with the line that has others, or for more lines than seeds."""
    lines = answer.split(b"\n")[:-1]
    if len(lines) != seeds.size:
        raise SubjectError(f"printed {len(lines)} lines for {seeds.size} seeds: print one for each")
    rows = [_floats(line.split()) for line in lines]
    for row, line, seed in zip(rows, lines, seeds, strict=True):
        if len(row) != width:
            raise SubjectError(
                f"printed {line.decode(errors='replace')!r:.80} for seed {seed}: expected {width} numbers"
            )
    return np.array(rows, dtype=float).reshape(seeds.size, width)


def _floats(words: Any) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError:
        return []


def _channels(pixel: PixelLike) -> int:
    return len(pixel.values[0]) if isinstance(pixel.values[0], tuple) else 1
