"""Unbiasedness proved from the structure of a plan, for every pixel at once.

"Decide how a sample is going to be used before it is drawn" (Kirk & Arvo 1991, section 4), made a rule
about the tree of paths. A sample mean may stand for the true mean of its region where its weight (1) does
not look at the sample itself and (2) is settled before the first decision that does, alike at all ends
below; (3) what is left has to be the true mean of X, at every end or on average over the coins. Each
step leaves E[xi] as it is, so what passes is unbiased; of anything else nothing is said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

from truemean.errors import InputError
from truemean.oracle.cases import Formulas, conditions, each, ratios, restricted, used_generators
from truemean.oracle.exact import exact_number
from truemean.oracle.plan import Plan, as_plan
from truemean.oracle.stand_in import Drawn, NoProof, Place, bounds, world
from truemean.oracle.symbols import Ratio
from truemean.oracle.walk import Tree
from truemean.oracle.wording import text

__all__ = ["Structure", "structural_proof"]

_EVERY = "every pixel"
_MOST_SAID = 6
_NO = "not proved: "


@dataclass(frozen=True, slots=True)
class Structure:
    """Whether the structure of a plan alone makes it unbiased, and why; ``pixels`` says for which pixels."""

    proved: bool
    reason: str
    pixels: str = _EVERY
    paths: int = 0
    samples: tuple[str, ...] = ()


def structural_proof(
    plan: Any, params: Mapping[str, Any] | None = None, parts: Mapping[str, Any] | None = None
) -> Structure:
    """Whether a plan is unbiased on every pixel because of how it uses its samples (Kirk & Arvo 1991, section 4).

    ``parts`` maps the names of declared regions to their areas; without it ``X.regions`` is empty, or
    R and rest. Not proved does not mean biased. Raises PlanError for a plan that returns no number.

    >>> from truemean.oracle.plans import catalogue
    >>> structural_proof(catalogue["discard-pilot"]).reason
    'S1 only decides and is discarded; S2 is fresh when it is weighted'
    >>> structural_proof(catalogue["kirk-arvo"]).reason
    'not proved: the weight of S1 depends on range(S1) <= 0, which looks at S1'
    """
    declared = as_plan(plan)
    areas = None if parts is None else {name: exact_number(area, f"area of {name}") for name, area in parts.items()}
    if areas is not None and sum(areas.values()) != 1:
        raise InputError(f"the areas of parts {', '.join(areas)} sum to {sum(areas.values())}, not to 1")
    return _proved(declared, declared.bind(params or {}), areas, {})


def _proved(
    plan: Plan, params: dict[str, Any], areas: Mapping[str, Any] | None, known: dict[Any, tuple[Structure, Any]]
) -> Structure:
    """The proof of a plan; of plans that it uses for parts, each is proved once."""

    def prove(inner: Plan, given: dict[str, Any]) -> Structure:
        bound = inner.bind(given)
        key = (inner.function, inner.undefined, repr(sorted(bound.items())))
        if key not in known:
            known[key] = Structure(proved=False, reason=f"{_NO}{inner.name} calls itself without end"), bound
            known[key] = _proved(inner, bound, None, known), bound  # what the key shows stays alive with it
        return known[key][0]

    tree = Tree(plan, params, areas, prove)
    try:
        tree.walk()
    except NoProof as reason:
        return Structure(proved=False, reason=f"{_NO}{reason}")
    try:
        return _Proof(tree).structure()
    except (NoProof, InputError) as reason:
        return Structure(proved=False, reason=f"{_NO}{reason}", paths=tree.paths)
    except RecursionError:
        return Structure(proved=False, reason=f"{_NO}a formula is nested too deep to be followed", paths=tree.paths)


class _Refusal(Exception):
    """A condition that does not hold, in words."""


@dataclass(frozen=True, slots=True)
class _End:
    """An end of the tree: the decisions on the way, and what was drawn."""

    path: tuple[tuple[Place, bool], ...]
    draws: frozenset[int]


class _Proof:
    """Sample means are replaced by true means, one after the other, until no condition lets go on."""

    def __init__(self, tree: Tree) -> None:
        self.tree, self.formulas = tree, Formulas(tree)
        self.ends: list[_End] = []
        self.estimates: list[Any] = []
        self.below: dict[Place, list[int]] = {}
        self.drawn_by: dict[Place, frozenset[int]] = {}
        self.refusals: dict[int, str] = {}
        self.weights: dict[int, list[Any]] = {}
        self.coefficients: list[frozenset[int]] = []  # what weights look at
        self.coins: list[str] = []
        self.worlds: set[str] = set()
        self._collect(tree.root, (), frozenset())

    def _collect(self, place: Place, path: tuple[tuple[Place, bool], ...], above: frozenset[int]) -> None:
        """Read the estimate at every end."""
        first = len(self.ends)
        draws = above | frozenset(place.draws)
        if place.asked is not None:
            for side, below in place.sides.items():
                self._collect(below, (*path, (place, side)), draws)
        elif not place.lacking:
            self.ends.append(_End(path, draws))
            self.estimates.append(self._known_choices(self.formulas.value(place.estimate), path))
            self.worlds |= world(path)
        self.below[place], self.drawn_by[place] = list(range(first, len(self.ends))), draws

    def _known_choices(self, estimate: Any, path: tuple[tuple[Place, bool], ...]) -> Any:
        """On a path where a coin was thrown, its side is known."""
        for place, side in path:
            for condition in conditions(estimate) & self.formulas.tests.keys():
                choice, option = self.formulas.tests[condition]
                if place.test is not None and place.test.choice == choice:
                    same = option == place.test.option
                    if same or side:
                        estimate = restricted(estimate, condition, same == side)
        return estimate

    def _reads(self, place: Place) -> frozenset[int]:
        return frozenset() if place.asked is None else self.formulas.reads(place.asked)

    # -- from sample means to true means -------------------------------------------------------

    def settle(self) -> None:
        """Replace sample means while some weight meets conditions (1) and (2)."""
        waiting, before = self._uses(), -1
        while len(waiting) != before:
            before, self.refusals = len(waiting), {}
            waiting = [use for use in waiting if not self._replaced(*use)]

    def _uses(self) -> list[tuple[int, Place | None, list[int]]]:
        """Each sample with the first decision that looks at it and the ends below, or a single end without one."""
        uses: dict[tuple[int, Any], tuple[int, Place | None, list[int]]] = {}
        for number, end in enumerate(self.ends):
            for drawn in end.draws:
                if self.tree.draws[drawn].kind in ("sample", "estimate"):
                    first = next((place for place, _ in end.path if drawn in self._reads(place)), None)
                    ends = [number] if first is None else self.below[first]
                    uses[drawn, number if first is None else first] = (drawn, first, ends)
        return sorted(uses.values(), key=lambda use: (use[1] is None, -use[0]))

    def _replaced(self, drawn: int, first: Place | None, ends: list[int]) -> bool:
        mean = self.formulas.mean(drawn)
        try:
            weights = [each(lambda x: self._slope(x, mean, drawn), self.estimates[end]) for end in ends]
            if not any(ratio for weight in weights for ratio in ratios(weight)):
                return True
            for weight in weights:
                self.no_weight_looks_at_its_own_sample(drawn, weight)
            if first is not None:
                self.weight_is_settled_before_the_first_look(drawn, first, dict(zip(ends, weights, strict=True)))
        except _Refusal as refusal:
            self.refusals.setdefault(drawn, str(refusal))
            return False
        truth = self.formulas.true_mean(self.tree.draws[drawn].region)
        for end, weight in zip(ends, weights, strict=True):
            self.estimates[end] = each(lambda x, w: x + w * (truth - mean), self.estimates[end], weight)
        self.weights.setdefault(drawn, []).extend(weights)
        self.coefficients += map(self.formulas.looks_at, weights)
        return True

    def _slope(self, ratio: Ratio, mean: Ratio, drawn: int) -> Ratio:
        """The weight of a sample mean in an estimate."""
        num, den = ratio.lifted()
        place = self.formulas.place(mean)
        if den.degrees()[place] or num.degrees()[place] > 1:
            raise _Refusal(f"the estimate is no weighted sum of mean({self._name(drawn)}) and other terms")
        return Ratio.reduced(self.tree.field, num.derivative(place), den)

    def no_weight_looks_at_its_own_sample(self, drawn: int, weight: Any) -> None:
        """Condition (1)."""
        if drawn in self.formulas.looks_at(weight):
            name = self._name(drawn)
            raise _Refusal(f"the weight of {name}, {self.formulas.say(weight)}, looks at {name} itself")

    def weight_is_settled_before_the_first_look(self, drawn: int, first: Place, weights: dict[int, Any]) -> None:
        """Condition (2)."""
        weight, name = next(iter(weights.values())), self._name(drawn)
        if any(other != weight for other in weights.values()):
            place = self._parting(first, weights)
            looks = f"looks at {name}" if drawn in self._reads(place) else f"comes after {first.words[True]}"
            raise _Refusal(f"the weight of {name} depends on {place.words[True]}, which {looks}")
        for later in self.formulas.looks_at(weight) - self.drawn_by[first]:
            raise _Refusal(
                f"the weight of {name} looks at {self._name(later)}, drawn after {first.words[True]} was decided"
            )

    def _parting(self, place: Place, weights: dict[int, Any]) -> Place:
        """The decision by which weights differ first."""
        for below in place.sides.values():
            own = [weights[end] for end in self.below[below]]
            if any(weight != own[0] for weight in own):
                return self._parting(below, weights)
        return place

    # -- from true means of regions to that of X ------------------------------------------------

    def average_is_the_true_mean(self) -> bool:
        """Condition (3)."""
        if not self.ends:
            raise _Refusal("no pixel has what the plan asks for, such as regions of these names")
        found = self._averaged(self.tree.root, ())
        if found == self.formulas.true_mean(0):
            return True
        raise _Refusal(self._no_mean(found))

    def _averaged(self, place: Place, path: tuple[Place, ...]) -> Any:
        """The estimate on average over coins, the same on both sides of every other decision."""
        if place.asked is None:
            (end,) = self.below[place]
            return self._without_coins(each(self.formulas.spread, self.estimates[end]), path)
        sides = {s: self._averaged(b, (*path, place)) for s, b in place.sides.items() if self.below[b]}
        found = list(sides.values())
        if len(found) == 1 or found[0] == found[1]:
            return found[0]
        if place.test is not None and self._free(place.test.choice, found, path):
            chances = {o: self._chance(place.test.choice, o) for o in place.test.remaining}
            self.coins.append(self._name(place.test.choice))
            own = {o: sides[o == place.test.option] for o in chances}
            return self._mixed(place.test.choice, chances, own)
        right = self.formulas.true_mean(0)
        side = next(s for s, formula in sides.items() if formula != right)
        raise _Refusal(f"where {place.words[side]}, {self._no_mean(sides[side])}")

    def _free(self, choice: int, formulas: list[Any], path: tuple[Place, ...]) -> bool:
        """Whether nothing but tests of this very choice depends on how it fell."""
        others = [p for p in path if p.test is None or p.test.choice != choice]
        return not any(choice in looks for looks in (*map(self._reads, others), *map(self.formulas.looks_at, formulas)))

    def _without_coins(self, estimate: Any, path: tuple[Place, ...]) -> Any:
        """The average over choices that stand in the estimate, but in no decision."""
        tests = self.formulas.tests
        for choice in sorted({tests[c][0] for c in conditions(estimate) & tests.keys()}):
            own = {}
            for option in range(len(self.tree.draws[choice].looks)):
                own[option] = estimate
                for condition in [c for c in conditions(estimate) & tests.keys() if tests[c][0] == choice]:
                    own[option] = restricted(own[option], condition, tests[condition][1] == option)
            if self._free(choice, list(own.values()), ()) and not any(choice in self._reads(p) for p in path):
                self.coins.append(self._name(choice))
                estimate = self._mixed(choice, {o: self._chance(choice, o) for o in own}, own)
        return estimate

    def _chance(self, choice: int, option: int) -> Any:
        return self.formulas.value(self.tree.draws[choice].looks[option])

    def _mixed(self, choice: int, chances: dict[int, Any], formulas: dict[int, Any]) -> Any:
        """The average of formulas over the options of a choice."""
        weights = self.tree.draws[choice].looks

        def term(total: Any, chance: Any, formula: Any, whole: Any, sure: bool) -> Any:
            if not chance:
                return total
            if not sure and formula.den is not None and not formula.den.is_constant() and not chance.is_constant:
                raise _Refusal(f"the weights divide by what may be 0 where {self._name(choice)} can't fall so")
            return total + chance * formula / whole

        whole = reduce(lambda a, b: each(lambda x, y: x + y, a, b), chances.values())
        total: Any = self.tree.field.number(0)
        for option, chance in chances.items():
            sure = bounds(weights[option])[0] > 0
            total = each(lambda t, c, f, w, sure=sure: term(t, c, f, w, sure), total, chance, formulas[option], whole)
        return total

    # -- words ---------------------------------------------------------------------------------

    def structure(self) -> Structure:
        """The verdict."""
        pixels = self._pixels()
        try:
            self.settle()
            self.average_is_the_true_mean()
        except _Refusal as refusal:
            return Structure(False, f"{_NO}{self._obstacle() or refusal}", pixels, self.tree.paths)
        looks = [*map(self._reads, self.below), *self.coefficients]
        behind = [self.formulas.behind(d.number) - {d.number} for d in self.tree.draws]
        looked: frozenset[int] = frozenset().union(*looks, *behind)
        roles = tuple(dict.fromkeys(filter(None, (self._role(d, d.number in looked) for d in self.tree.draws))))
        said = roles[:_MOST_SAID] or ("the estimate is the true mean itself",)
        more = (f"and {len(roles) - _MOST_SAID} samples more",) if len(roles) > _MOST_SAID else ()
        return Structure(True, "; ".join(said + more), pixels, self.tree.paths, roles)

    def _obstacle(self) -> str | None:
        """What kept some sample mean from being replaced."""
        used = {i for e in self.estimates for ratio in ratios(e) if ratio is not None for i in used_generators(ratio)}
        for drawn in self.tree.draws:
            kind, name, number = drawn.kind, drawn.name, drawn.number
            if self.formulas.place(self.formulas.mean(number)) not in used:
                continue
            if kind == "stopped":
                return f"{name} stops where {text(self.tree.stops[number][0])}, which looks at {name}"
            if kind == "opaque":
                return f"{name} is used, where {self.tree.inner[number].reason.removeprefix(_NO)}"
        return self.refusals[min(self.refusals)] if self.refusals else None

    def _no_mean(self, found: Any) -> str:
        for ratio in ratios(found):
            for place in sorted(used_generators(ratio)) if ratio is not None else ():
                if self.formulas.looks_at(Ratio(self.tree.field, self.tree.field.context.gen(place))):
                    return f"the estimate has {self.formulas.words[place]} in it, which is no weighted mean"
        return f"the estimate averages to {self.formulas.say(found)}, not to the true mean"

    def _role(self, drawn: Drawn, looked: bool) -> str | None:
        """What a sample is for."""
        number, name = drawn.number, drawn.name
        weights = list(dict.fromkeys(self.formulas.say(w) for w in self.weights.get(number, []) if any(ratios(w))))
        if drawn.kind == "choice":
            return f"the weights make up for {name}" if name in self.coins else None
        if not weights:
            return f"{name} only decides and is discarded" if looked else f"{name} is drawn for nothing"
        if len(weights) > 1 or not looked:
            return f"{name} is fresh when it is weighted"
        region = self.tree.regions[drawn.region].law.name
        return f"{name} estimates {region} at the fixed weight {weights[0]} and otherwise only decides"

    def _pixels(self) -> str:
        """For which pixels the walk speaks."""
        declared = self.tree.declared
        worlds = sorted(self.worlds) + ([f"of regions {', '.join(declared)}"] if declared else [])
        own = f"pixels {', or '.join(worlds)}" if worlds and worlds != ["of a scene", "without a scene"] else _EVERY
        inner = {p.pixels for p in self.tree.inner.values() if p.proved} - {_EVERY, own}
        return own + "".join(f" (in sub-estimates: {words})" for words in sorted(inner))

    def _name(self, drawn: int) -> str:
        return self.tree.draws[drawn].name
