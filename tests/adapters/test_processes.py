"""exec: programs that keep the protocol, and all the ways in which others break it.

Replicates are those of fixed seeds. A verdict on them is wrong with a probability of 1 %, and was looked at once.
"""

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tests.adapters.compiled import Compiled
from tests.adapters.programs import program
from tests.command_line import call

from truemean.adapters import load
from truemean.conformance import Verdict, check_subject, judge, standard_pixels
from truemean.conformance.replicates import Seeds
from truemean.errors import InputError, SubjectError, UnknownName
from truemean.oracle.pixel import Pixel

PIXELS = {"eighth": Pixel.two("1/8"), "half": Pixel.two("1/2")}
COLOUR = Pixel({(1, 0, 0): "1/2", (0, 1, 0): "1/4", (0, 0, 1): "1/4"})
BAD = int(Seeds(seed=7, bits=53, stream=0, streams=2).take(50, 51)[0])  # of the first pixel, in its fourth batch or so


@pytest.fixture(scope="session")
def compiled(tmp_path_factory):
    return Compiled(tmp_path_factory.mktemp("programs"))


def judged(subject, tolerance=0, budget=120, pixels=PIXELS):
    return judge(load(subject), pixels=pixels, tolerance=tolerance, budget=budget, seed=7)


def assert_broken(report, *words):
    """The first pixel is, with what was seen before; the other is judged all the same."""
    broken, other = report.cases
    assert (broken.verdict, other.verdict) == (Verdict.BROKEN, Verdict.INCONCLUSIVE)
    assert [word for word in words if word not in broken.reason] == []
    assert (broken.replicates > 0, other.replicates >= 120) == (True, True)


# -- examples ---------------------------------------------------------------------------------------


def test_the_c_example_is_as_biased_as_its_plan(compiled):
    report = judge(
        load(f"exec:{compiled.program('estimator.c')}"),
        tolerance="5%",
        declares=("two-stage-pooled", {"n": 4, "m": 12, "eps": 0}),
        seed=7,
    )
    verdicts = {case.pixel: case.verdict for case in report.cases}
    biased = {"eighth", "quarter", "three-quarters", "seven-eighths"}
    assert {name for name, verdict in verdicts.items() if verdict is Verdict.BIASED} == biased
    assert {name for name, verdict in verdicts.items() if verdict is Verdict.CONFORMS} == verdicts.keys() - biased
    assert str(report.plan_check) == "FOLLOWS"
    assert report.skipped == {"equal-luminance": "colours"}


def test_the_cpp_example_is_unbiased_and_knows_colours(compiled):
    report = judge(load(f"exec:{compiled.program('estimator.cpp')}"), tolerance="5%", seed=7)
    assert report.verdict is Verdict.CONFORMS
    assert len(report.cases) == 13
    assert {case.cost for case in report.cases} == {None}


@pytest.mark.parametrize("name", ["estimator.c", "estimator.cpp"])
def test_examples_keep_the_promises_of_an_estimator(compiled, name):
    check_subject(load(f"exec:{compiled.program(name)}"), pixels=standard_pixels())


@pytest.mark.parametrize(
    ("name", "tolerance", "code"),
    [("estimator.c", "5%", 1), ("estimator.cpp", "10%", 0), ("estimator.cpp", "0", 3), ("estimator.rs", "1%", 1)],
)
def test_the_command_line_judges_examples(compiled, name, tolerance, code):
    pixel = ("--pixels", "0:7/8,1:1/8", "--budget", "10000")
    assert call("judge", f"exec:{compiled.program(name)}", "--tolerance", tolerance, *pixel)[0] == code


# -- what is kept -----------------------------------------------------------------------------------


def test_a_program_is_given_pixels_and_seeds_as_they_are(tmp_path):
    told = tmp_path / "told"
    subject = load(
        program(tmp_path, f"told = open({str(told)!r}, 'w')\nestimate = lambda seed: (told.write(f'{{seed}} '), 0)[1]")
    )
    seeds = [0, 1, 2**53 - 1]
    assert subject.run(PIXELS["eighth"], seeds).tolist() == [0, 0, 0]
    assert subject.costs(PIXELS["eighth"], seeds) is None
    del subject
    assert told.exists()


def test_costs_versions_and_bits_of_seeds_are_told(tmp_path):
    greeting = "def greet(): say('truemean 1 costs seed_bits=31 version=2.5')\ndef estimate(seed): return f'0.5 {seed}'"
    subject = load(program(tmp_path, greeting))
    assert (subject.seed_bits, [*subject.versions.values()]) == (31, ["2.5"])
    assert subject.run(PIXELS["half"], [3, 4]).tolist() == [0.5, 0.5]
    assert subject.costs(PIXELS["half"], [3, 4]).tolist() == [3, 4]


def test_text_and_binary_are_the_same_numbers(tmp_path):
    (tmp_path / "binary").mkdir()
    binary = """
def greet(): say("truemean 1 binary")
def batch(seeds):
    sys.stdout.buffer.write(struct.pack(f"<{len(seeds)}d", *map(estimate, seeds)))
    sys.stdout.buffer.flush()
"""
    one, other = load(program(tmp_path)), load(program(tmp_path / "binary", binary))
    seeds = np.arange(1000) * (2**53 // 1000)
    assert other.binary
    assert np.array_equal(one.run(PIXELS["eighth"], seeds), other.run(PIXELS["eighth"], seeds))


def test_what_it_declines_is_skipped(tmp_path):
    declines = "def pixel(): say('unsupported more than one light' if weights[0] == 0.5 else 'ok')"
    report = judged(program(tmp_path, declines))
    assert report.skipped == {"half": "more than one light"}
    assert [case.pixel for case in report.cases] == ["eighth"]


def test_errors_of_ten_megabytes_are_read_on_the_way(tmp_path):
    noisy = "def batch(seeds, batch=batch):\n    print('x' * 10**7, file=sys.stderr)\n    batch(seeds)\n    print('y' * 10**7, file=sys.stderr)"
    subject = load(program(tmp_path, noisy))
    assert [subject.run(PIXELS["eighth"], [seed, seed + 1]).size for seed in range(3)] == [2, 2, 2]


def test_long_requests_and_answers_pass_at_once(tmp_path):
    eager = "def batch(seeds): pass\nread = lambda: sys.stdin.buffer.readline().decode()"
    at_once = """
loop = read
def read():
    line = loop()
    if line.startswith("run"):
        for _ in range(int(line.split()[1])):
            sys.stdout.write(f"{estimate(int(loop()))}\\n")
        sys.stdout.flush()
        return read()
    return line
"""
    assert eager
    subject = load(program(tmp_path, f"estimate = lambda seed: '0.12345678901234567'\n{at_once}"))
    assert subject.run(PIXELS["eighth"], 2**52 + np.arange(100_000)).shape == (100_000,)


# -- what is broken at one seed ---------------------------------------------------------------------

AT = f"def estimate(seed, honest=estimate):\n    if seed == {BAD}:\n        "
REST = "\n    return honest(seed)"


@pytest.mark.parametrize(
    ("does", "words"),
    [
        ("os._exit(3)", [f"at seed {BAD} it ended with exit code 3"]),
        ("os._exit(0)", [f"at seed {BAD} it ended with exit code 0"]),
        ("os.kill(os.getpid(), signal.SIGSEGV)", [f"at seed {BAD} it was killed by signal SIGSEGV"]),
        ("raise ValueError('no light')", [f"at seed {BAD} it ended with exit code 1; standard error: ", "no light"]),
        ("sys.stderr.write('x' * 10**7 + 'the end'); os._exit(3)", ["exit code 3; standard error: xxx", "xthe end"]),
        ("os.close(1); time.sleep(9)", [f"at seed {BAD} it closed its standard output"]),
        ("time.sleep(100)", [f"at seed {BAD} it did not answer within 1 s"]),
        (
            "sys.stdout.write('0.2'); sys.stdout.flush(); os._exit(0)",
            ["exit code 0, its answer so far ending '", "0.2'"],
        ),
        ("sys.stdout.write('0.2'); sys.stdout.flush(); time.sleep(100)", [f"at seed {BAD} it did not", "ending '0.2'"]),
        ("say('0\\n' * 10**6)", [f"at seed {BAD} it printed more than was asked"]),
        ("return float('nan')", [f"returned NaN for seed {BAD}"]),
        ("return 'inf'", [f"returned inf for seed {BAD}, outside its range"]),
        ("return 'bright'", [f"printed 'bright' for seed {BAD}: expected 1 number"]),
        ("return '0.5 0.5'", [f"printed '0.5 0.5' for seed {BAD}: expected 1 number"]),
        ("return ''", [f"printed '' for seed {BAD}: expected 1 number"]),
        ("return chr(233)", [f"for seed {BAD}: expected 1 number"]),
    ],
)
def test_the_seed_at_which_it_breaks_is_named(tmp_path, does, words):
    report = judged(program(tmp_path, AT + does + REST, timeout=1))
    assert_broken(report, *words)
    assert len(report.cases[0].reason) < 2300


def test_a_seed_that_hangs_is_named_among_slow_ones(tmp_path):
    slow = "def estimate(seed):\n    time.sleep(100 if seed == 13 else 0.02)\n    return 0"
    with pytest.raises(SubjectError, match=r"^at seed 13 it did not answer within 1 s$"):
        load(program(tmp_path, slow, timeout=1)).run(PIXELS["eighth"], np.arange(16))


# -- what is broken at none in particular -----------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ("def batch(seeds): say('\\n'.join(['0'] * (len(seeds) + 1)))", ["printed 17 lines for 16 seeds"]),
        (
            "def batch(seeds): sys.stdout.write('0\\n' * (len(seeds) - 1)), sys.stdout.flush()",
            ["it did not answer within 0.5 s"],
        ),
        ("def batch(seeds): pass", ["it did not answer within 0.5 s"]),
        ("def batch(seeds): say('0\\n' * 10**6)", ["it printed more than was asked"]),
        ("def pixel(): say('what?')", ["answered 'what?' to a pixel: expected ok, or unsupported REASON"]),
        ("def pixel(): os._exit(2)", ["ended with exit code 2, when told 'pixel 2 1'"]),
    ],
)
def test_what_always_breaks_is_told(tmp_path, changes, words):
    halves = changes + "\ndef pixel(ever=pixel): ever() if weights[0] != 0.5 else say('unsupported half')"
    report = judged(program(tmp_path, halves, timeout=0.5))
    (case,) = report.cases
    assert (case.verdict, case.replicates) == (Verdict.BROKEN, 0)
    assert [word for word in words if word not in case.reason] == []


def test_a_line_too_many_is_noticed_before_the_next_batch(tmp_path):
    def batches():
        for i in range(3):
            subject.run(PIXELS["eighth"], np.arange(4) + i)
            time.sleep(0.2)

    subject = load(program(tmp_path, "def batch(seeds, batch=batch):\n    batch(seeds)\n    say('that was it')"))
    with pytest.raises(SubjectError, match=r"was not asked for, 'that was it\\n'|printed 5 lines for 4 seeds"):
        batches()


def test_what_breaks_once_and_not_again_is_told(tmp_path):
    mark = tmp_path / "mark"
    once = f"""
def estimate(seed, honest=estimate):
    if seed == {BAD} and not os.path.exists({str(mark)!r}):
        open({str(mark)!r}, "w").close()
        os.abort()
    return honest(seed)
"""
    assert_broken(
        judged(program(tmp_path, once)), "once in ", "not again at any of them alone, it was killed by signal SIGABRT"
    )


def test_a_program_of_one_batch_is_broken(tmp_path):
    subject = load(program(tmp_path, "def batch(seeds, batch=batch):\n    batch(seeds)\n    sys.exit()"))
    assert subject.run(PIXELS["eighth"], [1, 2]).size == 2
    with pytest.raises(SubjectError, match=r"^once in 8 seeds, .*, it ended with exit code 0$"):
        subject.run(PIXELS["eighth"], np.arange(8))
    with pytest.raises(SubjectError, match=r"^at seed 4, and not when it was asked again, it ended with exit code 0$"):
        subject.run(PIXELS["eighth"], [4])


def test_a_program_that_can_start_but_once_is_told_what_it_said_then(tmp_path):
    mark = tmp_path / "mark"
    once = f"if os.path.exists({str(mark)!r}): sys.exit('is running')\nopen({str(mark)!r}, 'w').close()\n"
    with pytest.raises(SubjectError, match=r"^ended with exit code 3; it was given 16 seeds$"):
        load(program(tmp_path, f"{once}def batch(seeds): os._exit(3)")).run(PIXELS["eighth"], np.arange(16))


@pytest.mark.parametrize(
    ("estimate", "words"),
    [
        ("return random.random()", "for the same seed"),
        ("return 0.25", "returned one and the same estimate"),
    ],
)
def test_a_program_that_ignores_its_seed_is_refused(tmp_path, estimate, words):
    subject = program(tmp_path, f"def estimate(seed): {estimate}")
    with pytest.raises(SubjectError, match=words):
        judged(subject)
    code, _, err = call("judge", subject, "--tolerance", "1%", "--pixels", "0:7/8,1:1/8")
    assert (code, words in " ".join(err.split())) == (4, True)


@pytest.mark.parametrize(
    ("write", "words"),
    [
        ("bytes(8 * len(seeds) - 1)", "did not answer within 0.5 s"),
        ("bytes(8 * len(seeds) + 8)", "printed more than was asked"),
    ],
)
def test_binary_answers_have_the_right_length(tmp_path, write, words):
    binary = (
        f"def greet(): say('truemean 1 binary')\ndef batch(seeds): sys.stdout.buffer.write({write}), sys.stdout.flush()"
    )
    with pytest.raises(SubjectError, match=f"^at seed 0 it {words}"):
        load(program(tmp_path, binary, timeout=0.5)).run(PIXELS["eighth"], np.arange(16))


# -- time, and the way in and out -------------------------------------------------------------------


def test_the_time_of_all_answers_together_is_limited(tmp_path):
    slow = "def batch(seeds, batch=batch):\n    time.sleep(0.1)\n    batch(seeds)"
    report = judged(program(tmp_path, slow, total=1), pixels={"eighth": Pixel.two("1/8")})
    (case,) = report.cases
    assert (case.verdict, case.replicates > 0) == (Verdict.BROKEN, True)
    assert case.reason == "has used up the 1 s of total=1"


@pytest.mark.parametrize(
    ("greeting", "words"),
    [
        ("say('truemean 2')", ["answered 'truemean 2' to 'truemean 1'", "expected truemean 1, then any of costs, "]),
        ("say('truemean 1 fast')", ["answered 'truemean 1 fast'"]),
        ("say('hello')", ["answered 'hello'"]),
        ("say('')", ["answered ''"]),
        ("say('truemean 1 seed_bits=99')", ["seed_bits='99'", "from 1 to 63"]),
        ("say('truemean 1\\nhello')", ["printed more than a line", "'hello"]),
        ("say('x' * 10**6)", ["printed more than was asked"]),
        ("sys.exit('no licence')", ["ended with exit code 1; standard error: no licence, when told 'truemean 1'"]),
        ("time.sleep(100)", ["did not answer within 0.5 s, when told 'truemean 1'"]),
    ],
)
def test_a_greeting_that_is_none(tmp_path, greeting, words):
    subject = program(tmp_path, f"def greet(): {greeting}", timeout=0.5)
    with pytest.raises(SubjectError) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []


def test_a_broken_program_ends_the_command_with_4(tmp_path):
    arguments = ("--tolerance", "1%", "--pixels", "0:7/8,1:1/8")
    assert call("judge", program(tmp_path, "def greet(): say('hello')"), *arguments)[0] == 4
    code, out, _ = call("judge", program(tmp_path, "def batch(seeds): os.abort()"), *arguments)
    assert (code, "BROKEN" in out, "SIGABRT" in out) == (4, True, True)


@pytest.mark.parametrize(
    ("subject", "error", "words"),
    [
        ("exec:./no_such_program", InputError, ["'./no_such_program' can't be started", "give the path of a program"]),
        ("exec:/", InputError, ["'/' can't be started"]),
        ("exec:' '", InputError, ["' ' can't be started"]),
        ("exec:", InputError, ["command"]),
        ("exec: # nothing", InputError, ["'#' can't be started"]),
        ("exec:'unclosed", InputError, ["No closing quotation", "POSIX shell"]),
        ("exec:true?timeout=0", InputError, ["timeout='0'", "positive number of seconds"]),
        ("exec:true?timeout=soon", InputError, ["timeout='soon'"]),
        ("exec:true?total=-1", InputError, ["total='-1'"]),
        ("exec:true?time=1", UnknownName, ["option of adapter exec", "'time'", "timeout"]),
        ("exec:true", SubjectError, ["ended with exit code 0, when told 'truemean 1'"]),
    ],
)
def test_bad_commands(subject, error, words):
    with pytest.raises(error) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []
    assert call("judge", subject, "--tolerance", "1%")[0] == (4 if error is SubjectError else 2)


def lives(process):
    """Whether it runs; one that has ended may wait for its parent to notice."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
@pytest.mark.parametrize("ends", ["hangs", "is forgotten"])
def test_what_a_program_has_started_ends_with_it(tmp_path, ends):
    file = tmp_path / "started"
    starts = f"child = subprocess.Popen(['sleep', '1000'])\nopen({str(file)!r}, 'w').write(f'{{os.getpid()}} {{child.pid}}')\n"
    hangs = "def batch(seeds): time.sleep(1000)" if ends == "hangs" else ""
    subject = load(program(tmp_path, starts + hangs, timeout=0.5))
    processes = file.read_text().split()
    assert all(map(lives, processes))
    if ends == "hangs":
        with pytest.raises(SubjectError):
            subject.run(PIXELS["eighth"], np.arange(1))
    else:
        del subject
    deadline = time.monotonic() + 10
    while any(map(lives, processes)) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not any(map(lives, processes))
