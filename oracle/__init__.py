"""The oracle: the exact expected value of any declared sampling plan over a discrete pixel."""

from truemean.oracle.certificate import check_certificate
from truemean.oracle.derivation import Derivation, derive
from truemean.oracle.display import Comparison, compare
from truemean.oracle.enclosure import Enclosure
from truemean.oracle.float64 import Approx
from truemean.oracle.many import Many, derive_many
from truemean.oracle.pixel import Pixel
from truemean.oracle.plan import Plan, plan
from truemean.oracle.proof import Proof, prove
from truemean.oracle.simulate import simulate
from truemean.oracle.worst_case import WorstCase, smallest_n, worst_case

__all__ = [
    "Approx",
    "Comparison",
    "Derivation",
    "Enclosure",
    "Many",
    "Pixel",
    "Plan",
    "Proof",
    "WorstCase",
    "check_certificate",
    "compare",
    "derive",
    "derive_many",
    "plan",
    "prove",
    "simulate",
    "smallest_n",
    "worst_case",
]
