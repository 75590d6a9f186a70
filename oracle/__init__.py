"""The oracle: the exact expected value of any declared sampling plan over a discrete pixel."""

from truemean.oracle.derivation import Derivation, derive
from truemean.oracle.float64 import Approx
from truemean.oracle.many import Many, derive_many
from truemean.oracle.pixel import Pixel
from truemean.oracle.plan import Plan, plan
from truemean.oracle.simulate import simulate

__all__ = ["Approx", "Derivation", "Many", "Pixel", "Plan", "derive", "derive_many", "plan", "simulate"]
