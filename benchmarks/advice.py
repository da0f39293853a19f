"""What a reader of the engine study should do: ten lines whose names and numbers come from the stored study."""

from __future__ import annotations

from benchmarks.pareto import Point, supplied_by_engine
from benchmarks.stored_study import EngineStudy
from looping_pendulum.compare.convergence.report import halting_verdict
from looping_pendulum.compare.convergence.result import HALT, ErrorCause, ErrorSplit, VariantStudy
from looping_pendulum.compare.tables import number

MARK = "path_0.7s"


def advice(study: EngineStudy) -> str:
    """Return the ten lines as a Markdown list."""
    variants = [v for v in study.convergence.variants if v.engine != "reference"]
    own_points = {p.variant: p for p in study.pareto if not p.where}
    # What never halts has no law that grips, whoever supplies it: such a variant is no choice for anybody
    choices = [v for v in variants if v.variant != "defaults" and halting_verdict(v) != "never halts"]
    contact = [v for v in choices if supplied_by_engine(v)]
    fed = [v for v in choices if not supplied_by_engine(v)]
    lines = [
        "**Ask first who supplies the law**: where an adapter feeds the capstan law in, a run tests everything but that law.",
        f"**If the law may be fed in**, take {_best(fed, own_points)}.",
        f"**If it must be the engine's own**, take {_best(contact, own_points)}.",
        _cost(contact, fed, own_points),
        _defaults(variants),
        _first_defaults(variants),
        _model(variants),
        _halting(contact, fed),
        _spread(contact),
        _ladders(contact),
    ]
    return "".join(f"{k}. {line}\n" for k, line in enumerate(lines, 1))


def split_of(v: VariantStudy, quantity: str) -> ErrorSplit | None:
    """Return the split of one quantity's error; None if the variant has no value of it."""
    return next((s for s in v.splits if s.quantity == quantity), None)


def _mm(metres: float) -> str:
    return f"{number(metres, 1e3, 2)} mm"


def _best(variants: list[VariantStudy], own_points: dict[str, Point]) -> str:
    """Name the variant with the smallest error at its own settings, and the cheapest within ten times of that."""
    errors = {v.label: v.own.rms[MARK] for v in variants if v.own.ok}
    known = {name: rms for name, rms in errors.items() if rms is not None and name in own_points}
    best = min(known, key=lambda name: known[name])
    near = min((name for name, rms in known.items() if rms <= 10 * known[best]), key=lambda name: own_points[name].cpu)

    def words(name: str) -> str:
        return f"`{name}`: {_mm(known[name])} to 0.7 s for {number(own_points[name].cpu, digits=2)} CPU s per simulated second"

    return words(best) if near == best else f"{words(best)}; the cheapest nearly as good is {words(near)}"


def _cost(contact: list[VariantStudy], fed: list[VariantStudy], own_points: dict[str, Point]) -> str:
    costs = [[own_points[v.label].cpu for v in group if v.label in own_points] for group in (contact, fed)]
    of_contact, of_fed = (f"{number(min(each), digits=2)} to {number(max(each), digits=2)}" for each in costs)
    return f"**Reckon with an own law's cost**: {of_contact} CPU s per simulated second, against {of_fed} with a law fed in."


def _defaults(variants: list[VariantStudy]) -> str:
    parts = []
    for v in variants:
        if v.variant == "defaults":
            rms = v.own.rms[MARK]
            parts.append(f"`{v.engine}` is {_mm(rms)} off at 0.7 s" if v.own.ok and rms else f"`{v.engine}` loses the string")
    return f"**Never run an engine as it comes**: {', '.join(parts)}."


def _first_defaults(variants: list[VariantStudy]) -> str:
    """Name for each engine the defaults with which alone a run fails; without one, that which moves the path to 0.35 s most."""
    named = []
    for engine in dict.fromkeys(v.engine for v in variants):
        # Where a run ends with the adapter's own settings, no default is what ends it
        defaults = [d for v in variants if v.engine == engine and (v.own.ok or v.variant == "defaults") for d in v.defaults]
        failing = dict.fromkeys(d.what for d in defaults if not d.run.ok)
        moves = {d.what: moved for d in defaults if (moved := d.change["path_0.35s"]) is not None}
        worst = list(failing) or sorted(moves, key=lambda what: moves[what])[-1:]
        if worst:
            named.append(f"{engine} {', '.join(f'`{what}`' for what in worst)}")
    return f"**Change these defaults first**: {'; '.join(named)}."


def _model(variants: list[VariantStudy]) -> str:
    names = []
    for v in variants:
        split = split_of(v, MARK)
        if split is not None and split.model is not None and ErrorCause.MODEL in split.causes:
            names.append(f"`{v.label}` ({_mm(split.model)})")
    return f"**Do not refine where the model differs**: the error stays in the limit for {', '.join(names)}."


def _halting(contact: list[VariantStudy], fed: list[VariantStudy]) -> str:
    sure = [f"`{v.label}`" for v in fed if halting_verdict(v).startswith("yes")]
    scatters = []
    for v in contact:
        verdicts = [verdict for ladder in v.ladders for verdict in ladder.verdicts if verdict.quantity == HALT]
        if v.own.halting_time is not None:
            scatters += [max(known)] if (known := [verdict.scatter for verdict in verdicts if verdict.scatter]) else []
    return (
        f"**Do not read a halting time from one run of a chain**: it converges for {', '.join(sure)} only; the finest rungs of"
        f" variants with a law of their own scatter by {number(min(scatters), 1e3, 2)} to {number(max(scatters), 1e3, 2)} ms."
    )


def _spread(contact: list[VariantStudy]) -> str:
    spreads = {v.label: spread for v in contact if (spread := v.spread[MARK])}
    least, most = min(spreads, key=lambda k: spreads[k]), max(spreads, key=lambda k: spreads[k])
    return (
        "**Repeat a run from a start changed by 0.01 deg**, before you believe its digits: the error to 0.7 s spreads"
        f" by {_mm(spreads[least])} (`{least}`) to {_mm(spreads[most])} (`{most}`)."
    )


def _ladders(contact: list[VariantStudy]) -> str:
    ends = []
    for v in contact:
        for ladder in v.ladders:
            known = [rung.run.rms[MARK] for rung in ladder.rungs if rung.run.ok and rung.run.rms[MARK] is not None]
            own = v.own.rms[MARK]
            if known and own is not None:
                ends.append(known[-1] > own)
    return (
        f"**Refine all settings of a chain, never one**: at the end of {sum(ends)} of {len(ends)} ladders of such variants the"
        " path is farther from the reference than at the variant's own settings, whose errors partly cancel."
    )
