"""Made-up identifications of every verdict, with all that their pages can say: nothing of them was fitted.

Names are of no language: `NAMES` has those that a page shows as they are.
"""

import dataclasses
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np

from looping_pendulum.compare.landmarks import EVENT_QUANTITIES
from looping_pendulum.discrepancy.evidence.motions import COORDINATES_OF, TARGETS
from looping_pendulum.discrepancy.first_look import check, mistakes
from looping_pendulum.discrepancy.first_look.check import DeclarationCheck, NamedMistake, TrialCheck
from looping_pendulum.discrepancy.first_look.misfit import Distance
from looping_pendulum.discrepancy.first_look.row_times import RowShift
from looping_pendulum.discrepancy.fit.held_out import HeldOutTest
from looping_pendulum.discrepancy.fit.residual import GroupTest, ModelTest, ResidualTests, failures_in_words
from looping_pendulum.discrepancy.formulas import COORDINATE_UNITS, NO_FORMULA, forms
from looping_pendulum.discrepancy.result import (
    CorrelatedError,
    Experiment,
    ForceProfile,
    Formula,
    FormulaParameter,
    Identification,
    IdentifiedEffect,
    RankedExplanation,
    RecordStart,
    SmallestVisible,
    TrialError,
    TrialFigure,
    Unlisted,
    UnlistedLaw,
    Verdict,
)
from looping_pendulum.discrepancy.verdict_sentence import BODY_IN_WORDS, verdict_notes, verdict_sentence
from looping_pendulum.measured.displaced_rows import OWN_TIMES, WrongTimes, sentences
from looping_pendulum.measured.observations import Channel
from looping_pendulum.measured.study import Estimate
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from tests.pages import made_up

TITLE, TRIAL, OTHER_TRIAL, OWN = "Studie C", "Zug 1.5 m", "Zug 2", "ruck"
NAMES = (TITLE, TRIAL, OTHER_TRIAL, OWN, "Zug", "tilt", "looping", "held", "angle", "height", "t_A", "M2/M1")
"""Names of the study, its trials and its own effect, names in code that are one word, and symbols."""
GRAVITY = ("wrong_gravity", "gravity on Earth is 9.764 to 9.834 m/s^2")
ELSEWHERE = ("wrong_gravity", "gravity where the trials were made is 1.6 to 1.7 m/s^2")


def _effect(name: str, **changes) -> IdentifiedEffect:
    effect = made_up.identification("").effects[0]
    return dataclasses.replace(
        effect, **{"name": name, "kind": EffectKind.FORCE.value, "parameter": name, "depends_on": ("free_length",), **changes}
    )


EFFECT = _effect(
    OWN,
    parameter="k_1",
    depends_on=("time", "light_x"),
    companions=(("string_loss_time", 1e-3, 2e-4), ("bearing_friction", 0.1, 0.0)),
)
PUSH = _effect(
    "pivot_damping", kind=EffectKind.RELEASE.value, value=1.234e-7, error=3e-9, unit="N*m*s", depends_on=(), direction="x"
)
HELD = _effect(
    "static_friction",
    kind=EffectKind.STRING_LAW.value,
    interval=(1.18, None),
    null_value=1.0,
    unit="",
    meaning="multiplies",
    parameter="gamma1",
)
SMALL = _effect(
    "shear",
    interval=(None, 0.02),
    unit="",
    kind="measurement error",
    acts_on="camera",
    meaning="is, of the camera,",
    parameter="k_2",
)
MASS = _effect("wrong_light_mass", interval=(1.01, 1.05), unit="", null_value=1.0, kind="wrong value", acts_on="apparatus")
THICK = _effect("string_thickness", kind=EffectKind.PROPERTY.value, acts_on="string on rod")
OPEN = _effect("tilt", interval=(None, None), unit="rad", kind="measurement error", acts_on="camera", direction="y")
EVERY_EFFECT = (EFFECT, PUSH, HELD, SMALL, MASS, OPEN, THICK)
LAWS = tuple(
    UnlistedLaw(acts_on=target, depends_on=coordinate, multiplied_by=factor)
    for target, coordinates in COORDINATES_OF.items()
    for coordinate in coordinates
    for factor in ("constant", "retreat_speed", "across_speed")
)


def _explained(*effects, law=None, probability=0.3, odds=2.0, credible=True) -> RankedExplanation:
    return RankedExplanation(effects=effects, law=law, probability=probability, log10_odds=odds, credible=credible)


NOTHING = _explained(probability=1e-5, odds=0.0, credible=False)


def _errors() -> Iterator[TrialError]:
    """Trials of every kind, whose errors a model makes smaller or does not."""
    near = made_up.identification("").errors[0]
    for trial, held_out in ((TRIAL, False), (OTHER_TRIAL, True), ("blocks of time", True)):
        for after in (1e-3, 2.9e-3):
            error = dataclasses.replace(near, trial=trial, held_out=held_out, rms_after=after)
            yield error
            yield dataclasses.replace(error, standardised_rms_after=2.9)
            yield dataclasses.replace(error, rms_before=None, rms_after=None, unit="", standardised_rms_after=1e3 * after)


def failures() -> tuple[str, ...]:
    """What every test says that fails."""
    group = GroupTest(group="sliding, light along", count=30, chi2=4.0, lag1=9.0, ljung_box=0.0, runs=-9.0)
    events = ModelTest(
        subject="events", statistic="p of chi2 90.0 where 3.0 is expected", value=0.0, limit=5e-3, limit_is_lower=True,
        failure=f"the events are farther off than their errors explain, most of all {TRIAL} t_C 1 (+4.2 standard errors)",
    )  # fmt: skip
    found: list[str] = []
    for chi2 in (1.2, 9.0):
        found += failures_in_words(ResidualTests(chi2_per_dof=chi2, count=30, groups=(group,), events=events).results)
    for subjects in ((f"trial {TRIAL}", f"trial {OTHER_TRIAL}"), ("blocks of time",)):
        ones = (1.0,) * len(subjects)
        test = HeldOutTest(subjects=subjects, chi2=(9.0,) * len(subjects), counts=(30,) * len(subjects), limits=ones)
        found += failures_in_words(test.results)
    return tuple(dict.fromkeys(found))


def verdict_sentences() -> Iterator[str]:
    """Sentences of every verdict."""
    few = [_explained(EFFECT, PUSH), _explained(OPEN, law=LAWS[0])]
    many = [*few, _explained(HELD), _explained(law=LAWS[-1]), _explained(OPEN), _explained(MASS, OPEN, EFFECT)]
    force = made_up.identification("").unlisted
    failed = failures()
    for error in _errors():
        for verdict in Verdict:
            for own_effects in (False, True):
                for effects, credible in (
                    (EVERY_EFFECT[:1], few),
                    (EVERY_EFFECT, [*few, NOTHING]),
                    ((MASS,), many),
                    ((), [*many[:5], NOTHING]),
                    ((), [*many, many[0]]),
                ):
                    for law in (None, force, dataclasses.replace(force, multiplied_by="across_speed")):
                        for said in (failed[:1], failed[:4], failed[-3:-1], failed[-2:-1], failed[-1:]):
                            yield verdict_sentence(
                                verdict, effects, credible, law if verdict is Verdict.UNLISTED else None, (error,),
                                failures=said, own_effects=own_effects,
                            )  # fmt: skip


def notes() -> Iterator[str]:
    """Further remarks on every verdict."""
    correlated = tuple(
        CorrelatedError(body=body, amplitude=2e-3, unit=unit, correlation_time=0.05, points=5.0)
        for body, unit in zip(BODY_IN_WORDS, ("m", "m", "rad", "rad/s", "m"), strict=True)
    )
    outliers = made_up.identification(TRIAL).outliers
    for nearest in (
        _explained(OPEN), _explained(EFFECT, OPEN), _explained(PUSH, OPEN, MASS), _explained(OPEN, law=LAWS[4]),
        *(_explained(law=law) for law in LAWS),
    ):  # fmt: skip
        for verdict in Verdict:
            explanations = (nearest, _explained(law=LAWS[0]), _explained(law=LAWS[-1]), NOTHING)
            yield from verdict_notes(verdict, explanations, (GRAVITY, ELSEWHERE), correlated, outliers, trials=1)
    yield from _first_look_notes()


class _Undone(SimpleNamespace):
    """What a mistake's words are made of."""

    def value(self, parameter: str, *, corrected: bool = True) -> float:
        return {"release_angle": 1.5, "free_length": 0.3}.get(parameter, 0.1) * (1 if corrected else 2)


def _first_look_notes() -> Iterator[str]:
    far, near = Distance(rms=0.2, relative=0.4), Distance(rms=3e-3, relative=0.01)
    cut_off = Distance(rms=0.5, relative=1.0)
    few = Distance(reason="fewer than 4 points lie in the first 0.2 s of the declared motion")
    broken = Distance(reason="the declared motion could not be computed (tilt = 9)")
    texts = []
    for one in mistakes.MISTAKES:
        for factor in (0.04, 25.0):
            found = dataclasses.replace(one, keys=lambda undone: "mirrored: true' and 'units: {length: mm}")
            undone = _Undone(mistake=found, factors={"lengths": factor, "times": factor}, distance=near, declared=None)
            other = dataclasses.replace(one, keys=lambda undone: "", way_out=lambda undone: mistakes.SAME_ROWS)
            for before, trials, also in (
                (far, 1, []),
                (cut_off, 2, [other]),
                (few, 3, []),
                (broken, 1, []),
                (near, 1, [other]),
            ):
                explanations = [undone, *(_Undone(**{**vars(undone), "mistake": each}) for each in also)]
                searches = [SimpleNamespace(name=f"{TRIAL}{i}" if i else TRIAL, distance=before) for i in range(trials)]
                texts.append(check._mistake((one.name,), [(s, explanations) for s in searches]).text)
            rest = _Undone(**{**vars(undone), "mistake": dataclasses.replace(one, keys=lambda undone: "scale: 2")})
            members = [(SimpleNamespace(name=n, distance=far), [e]) for n, e in ((TRIAL, undone), (OTHER_TRIAL, rest))]
            texts.append(check._mistake((one.name,), members).text)
    for columns in ("light", "heavy", "light_x", "light_y"):
        for rows in (-1, 1, -3, 3):
            shift = RowShift(columns=columns, rows=rows)
            texts.append(f"{check._where([TRIAL])}: found {shift.text}; needed {mistakes.SAME_ROWS}")
    searched = SimpleNamespace(name=TRIAL, is_near=False, as_declared=SimpleNamespace(largest=99.0))
    texts += [check._far_text(SimpleNamespace(**vars(searched), distance=d)) for d in (far, cut_off, few, broken)]
    as_declared = SimpleNamespace(values={"origin_x": 0.1, "origin_y": -0.2})
    texts.append(
        check._origin_mistake(
            [SimpleNamespace(name=TRIAL, as_declared=as_declared, declared=SimpleNamespace(quarter_turns=0))]
        ).text
    )
    estimate = Estimate(value=99.0)
    declared = SimpleNamespace(trial=SimpleNamespace(name=TRIAL, release=check.Release.LOOPING), estimate=lambda name: estimate)
    texts += check._implausible_values([declared])
    wrong = (
        WrongTimes(t=0.1, factor=2.0), WrongTimes(t=0.2, factor=0.25), *(WrongTimes(t=0.1 * i, shift=0.02) for i in range(5)),
        WrongTimes(t=0.3, shift=-0.01), WrongTimes(t=0.4, shift=0.003, onward=False),
    )  # fmt: skip
    faults = [
        *sentences(wrong, 0.01),
        f"frames in turn last 1.2 and 0.83 of their mean, by the masses' motion, unlike their times; {OWN_TIMES}",
    ]
    texts += [f"{check._where([TRIAL, OTHER_TRIAL])}: {fault}" for fault in faults]
    named = [NamedMistake(trials=(), names=(), keys="", text=text) for text in texts]
    yield from DeclarationCheck(trials=(), mistakes=tuple(named)).notes


DATA = (
    f"{TRIAL}: used light_x 120, angle 5, height 7, angle_rate 3, events 2; 3 not used: light_x: empty cell; 1 not used: "
    "angle: a value without a time; 2 not used: light_y: the row before repeated; 4 not used: light_y: a copy of the point "
    "before; 2 not used: not measured: t_A 1, t_B 1; 4 not used: column 'Zug': not a time or a position; 8 not used: "
    "columns 'Zug', 'Zug 2': not times or positions; 8 not used: column 'Zug': track not asked for; 7 not used: columns "
    "'Zug', 'Zug 2' and 4 more: not times or positions; 6 not used: track 'Zug' and 4 more: not asked for; 9 not used: "
    "columns 'Zug', 'Zug 2': track not asked for; 3 not used: column 'w': not the rate of the angle (best multiple 0.5, "
    "correlation 0.93); 8 not used: track 'Zug': not asked for; 9 not used: angle_rate: at rest, before the release",
    f"{TRIAL}: used nothing; event errors taken as one unit of the last printed digit; lengths without a unit taken in mm; "
    "rates about 3 axes: taken about the one (0.00, 0.10, 0.99) that has 98 % of them; the first time, 0.3 s, was taken as "
    "0: the masses rest there; times printed to 0.001 s, which is coarse: put back on 240 frames a second; an export with "
    "more decimals needs no such step; times printed to 0.001 s: put back on 240 frames a second; an export with more "
    "decimals needs no such step; times printed to 0.001 s, at no equal steps: that rounding is an error of each time; "
    "times made for 30 frames a second were put to 240, taking one row as one frame; times made for 30 frames a second were"
    " put to 240; the steps from row to row are 3.1 to 5 ms, as the file has them; the steps from row to row are 3.1 to 5 "
    "ms, but the masses move as in equal ones: taken as 240 frames a second; setting in the table left out: Zug = 3; left "
    "out 3 of 80 rows (line 3, 4 and 2 more): they have fewer cells than there are names, and any may be missing; columns "
    "without names: taken as t [s], x, y; every picture is stored 2 times: one row of each is kept, 40 of 80; 5 rows show 2"
    " pictures: one row of each is kept, 32 of 80; by the masses' motion, pictures were taken unevenly, 1.2 ms beside their"
    " times: taken as an error of each time; at 0.3 s the masses are where they were a row before, as where a picture is "
    "stored again or a tracker slips: left out; at 0.3 s and 0.5 s the masses are where they were a row before, as where a "
    "picture is stored again or a tracker slips: left out; the film's points were read from zug.csv; zug.png shows the "
    "marks on it; The axes change with the frame (3 settings): each point is in those of its own frame.; The project shows "
    "positions relative to 'Zug'; they are read in fixed axes instead.; The project is not calibrated: positions are in "
    "pixels.; The project's step size is 2 frames.; Points of 'Zug' outside the project's clip (frames 3 to 9) were left "
    "out: 7.; Tracks that were left out: 'Zug'.; The frame times of the film do not rise, so that its frames are taken at "
    "equal steps.; A frame lasts 4 ms by the project's clock, which is used, and 33.3 ms by the film's.; Frames after 70, "
    "the last that has a time in the project, are taken at equal steps.; The project's clock reads 0.2 s at frame 3.",
)
"""What is said of trials that were read: of every table, film and project at once."""


def _force(law: UnlistedLaw, *, accepted: bool, chosen: int = 0) -> Unlisted:
    known = made_up.identification("").unlisted
    sides = TARGETS[law.acts_on]
    tried = tuple(
        Formula(form=form.name, depends_on=law.depends_on, multiplied_by=law.multiplied_by, accepted=accepted, delta_bic=9.0,
                parameters=tuple(FormulaParameter(name=t.name, value=0.1, error=0.01, unit="N s/m") for t in form.terms),
                delta_bic_of_profile=3.0, held_out_chi2=None, held_out_chi2_of_profile=1.0)
        for form in forms(law.acts_on)
    )  # fmt: skip
    profiles: list[ForceProfile] = []
    for side in sides:
        (profile,) = known.profiles
        seen = {} if accepted else {"significant_from": None, "significant_to": None, "formula": NO_FORMULA}
        profiles.append(dataclasses.replace(profile, side=side, **seen))
    return dataclasses.replace(
        known,
        acts_on=law.acts_on,
        depends_on=law.depends_on,
        multiplied_by=law.multiplied_by,
        unit=COORDINATE_UNITS[law.depends_on],
        profiles=tuple(profiles),
        formula=tried[(chosen // 2) % len(tried)] if accepted else None,
        formulas=tried,
        phase=("while the string slides", "while the string does not slide", "while the string slides and while it does not")[
            chosen % 3
        ],
        point=(0.1, -0.2) if law.depends_on == "distance" else None,
    )


def _look() -> DeclarationCheck:
    """A first look at two trials, of which one has a mistake, and one with angles alone."""
    t = np.linspace(0.0, 0.1, 9)
    paths = tuple((Channel(name=name, t=t, value=t), t) for name in ("light_x", "light_y", "heavy_x", "heavy_y"))
    angles = tuple((Channel(name=name, t=t, value=t), t) for name in ("angle", "height"))
    seen = {TRIAL: Distance(rms=0.2, relative=0.4, points=paths), OTHER_TRIAL: Distance(rms=0.1, relative=0.4, points=angles)}
    keys = "release: {free_length: 580 mm, angle: 90 deg}' and 'camera: {origin_x: free from 0.12 m, origin_y: free from 3 m}"
    corrected = {TRIAL: seen[TRIAL]}
    return DeclarationCheck(
        trials=tuple(TrialCheck(trial=trial, distance=distance) for trial, distance in seen.items()),
        mistakes=(
            NamedMistake(trials=(TRIAL,), names=(), keys=keys, text="", corrected=corrected),
            NamedMistake(
                trials=(OTHER_TRIAL,), names=(), keys="mirrored: true", text="", corrected={OTHER_TRIAL: seen[OTHER_TRIAL]}
            ),
        ),
    )


def _identification(verdict: Verdict, **changes) -> Identification:
    result = made_up.identification(TRIAL)
    (error,), (picture,), (event,), (outliers,) = result.errors, result.trial_figures, result.events, result.outliers
    failed = failures()
    tests = tuple(
        ModelTest(subject=subject, statistic=statistic, value=2.0, limit=1.0, limit_is_lower=lower, failure="")
        for subject in ("all tracked points", "sliding, light along", "not sliding, light across", "not sliding, heavy_x",
                        "sliding, angle", "not sliding, height", f"held-out trial {TRIAL}", "held-out blocks of time", "events")
        for statistic, lower in (("chi2 per degree of freedom", False), ("chi2 per value", False), ("Ljung-Box p", True),
                                 ("lag-1 autocorrelation z", False), ("runs z", True),
                                 ("p of chi2 90.1 where 3.0 is expected", True))
    )  # fmt: skip
    (parameter,) = result.before.parameters
    fit = dataclasses.replace(
        result.before, failed_tests=failed, tests=tests, start_costs=(1.0, 2.0),
        parameters=(dataclasses.replace(parameter, name=f"{TRIAL}.heavy_mass", at_bound=True),),
        correlations=((f"{TRIAL}.heavy_mass", "light_drag", -0.93), ("light_mass", "light_drag", 0.99)),
    )  # fmt: skip
    start = RecordStart(trial=TRIAL, held_out=False, time=0.3, angle=1.0, angle_error=0.01, speed=0.5, speed_error=0.02)
    experiment = Experiment(release="held", release_angle=1.0, free_length=0.3, mass_ratio=3.0, pairs=3, separated_pairs=1,
                            distance=8.0, tells_apart=(OWN, "nothing"))  # fmt: skip
    acts_on = [*dict.fromkeys(e.acts_on for e in EFFECTS.values() if e.kind is not EffectKind.CLOSURE), "camera", "apparatus"]
    every_event = [
        dataclasses.replace(
            event, quantity=q, trial=trial, held_out=held_out, unit=EVENT_QUANTITIES[q].unit, before=before, after=0.2
        )
        for q in EVENT_QUANTITIES
        for trial, held_out, before in ((TRIAL, False, None), (OTHER_TRIAL, True, 0.5))
    ]
    made = dataclasses.replace(
        result,
        title=TITLE,
        verdict=verdict,
        sentence="",
        notes=(f"{GRAVITY[0]} was ruled out, as {GRAVITY[1]}.",),
        effects=EVERY_EFFECT if verdict in (Verdict.IDENTIFIED, Verdict.AMBIGUOUS) else (),
        explanations=(
            _explained(*EVERY_EFFECT[:2], probability=0.6),
            _explained(OPEN, SMALL, law=LAWS[5]),
            _explained(PUSH, law=LAWS[-1]),
            _explained(law=LAWS[0], probability=None, credible=False),
            NOTHING,
            _explained(OPEN, MASS, probability=0.9999, credible=False),
        ),
        unlisted=None,
        correlated_noise=(CorrelatedError(body="light", amplitude=2e-3, unit="m", correlation_time=0.05, points=5.0),),
        record_starts=tuple(
            dataclasses.replace(start, angle_error=a, speed_error=s) for a in (0.0, 0.01) for s in (0.0, 0.02)
        ),
        smallest_visible=tuple(
            SmallestVisible(
                name=f"kg_{i}", value=1e-3 * (1 + i), unit=unit, acts_on=acts_on[i % len(acts_on)], null_value=null, motion=9.0
            )
            for i, (unit, null) in enumerate([("", 1.0), ("m/s**2", 0.0), ("N*m*s", 0.0), ("m/N", 0.0), ("1/kg", 0.0)] * 3)
        ),
        can_hide=("rod_mobility", OWN),
        next_experiments=(experiment, dataclasses.replace(experiment, tells_apart=("nothing", "light_drag"), mass_ratio=None)),
        errors=(
            dataclasses.replace(error, events_before={"s": 0.1, "m": 0.1}, events_after={"s": 0.1}),
            dataclasses.replace(error, trial=OTHER_TRIAL, held_out=True),
            dataclasses.replace(error, trial="blocks of time", held_out=True),
        ),
        events=tuple(every_event),
        outliers=(dataclasses.replace(outliers, held_out=True, intervals=((0.1, 0.1), (0.2, 0.3))),),
        before=fit,
        after=fit,
        data=DATA,
        first_look=_look(),
        provenance={"looping-pendulum": "1.2.0", "numpy": "2.1"},
        trial_figures=(
            picture,
            dataclasses.replace(picture, trial=OTHER_TRIAL, held_out=True),
            _of_channels(dataclasses.replace(picture, trial=f"{TRIAL}9"), {"light_x": "angle"}),
        ),
    )  # fmt: skip
    return dataclasses.replace(made, **changes)


def identifications() -> Iterator[Identification]:
    """Identifications of every verdict: all their parts, each way out, and every law and formula."""
    for verdict in Verdict:
        if verdict is not Verdict.UNLISTED:
            yield _identification(verdict)
    declared = _identification(Verdict.NO_MISSING_EFFECT)
    for count in range(3):
        yield dataclasses.replace(declared, smallest_visible=declared.smallest_visible[:count], can_hide=())
    for effects in ((MASS,), (OPEN,), (OPEN, PUSH), (PUSH,), (MASS, OPEN)):
        yield _identification(Verdict.IDENTIFIED, effects=effects)
    (experiment, other) = declared.next_experiments
    listed = (_explained(EFFECT), _explained(PUSH))
    for changes in (
        {"next_experiments": ()}, {"next_experiments": (other,)},
        {"next_experiments": (dataclasses.replace(experiment, pairs=1),)},
        {"next_experiments": (dataclasses.replace(experiment, separated_pairs=0),)},
    ):  # fmt: skip
        yield _identification(Verdict.AMBIGUOUS, explanations=listed, **changes)
    plain = dataclasses.replace(
        declared, verdict=Verdict.UNEXPLAINED, outliers=(), events=(), judged_on="held-out blocks of time"
    )
    yield plain
    for event in declared.events:
        yield dataclasses.replace(plain, events=(event,), before=dataclasses.replace(plain.before, failed_tests=()))
    light, _, angle = plain.trial_figures
    heavy = _of_channels(light, {"light_x": "heavy_x", "light_y": "heavy_y"})
    for picture in (light, heavy, angle):
        for held_out in (False, True):
            for magnified in (False, True):
                off = {name: values + 0.01 for name, values in picture.before.items()}
                shown = dataclasses.replace(picture, held_out=held_out, before=off if magnified else picture.before)
                for verdict in (Verdict.UNEXPLAINED, Verdict.IDENTIFIED):
                    yield _identification(verdict, trial_figures=(shown,), errors=plain.errors[2:], events=())
    bare = dict.fromkeys(("trial_figures", "events", "outliers", "record_starts", "data"), ()) | {"first_look": None}
    seen = set()
    for i, law in enumerate(LAWS):
        force = _force(law, accepted=bool(i % 2), chosen=i)
        yield _identification(
            Verdict.UNLISTED, unlisted=force, explanations=(_explained(law=law, probability=0.9), NOTHING), **bare
        )
        if law.depends_on in seen:
            continue
        seen.add(law.depends_on)
        for accepted in (False, True):
            force = _force(law, accepted=accepted)
            for explanations in ((_explained(EFFECT), _explained(law=law)), (_explained(law=law), _explained())):
                yield _identification(Verdict.AMBIGUOUS, unlisted=force, explanations=explanations, **bare)


def _of_channels(picture: TrialFigure, names: dict[str, str]) -> TrialFigure:
    """The same arrays as those of other channels."""
    arrays = {
        part: {new: getattr(picture, part)[old] for old, new in names.items()}
        for part in ("t", "measured", "before", "after", "residual_before", "residual_after", "outliers")
    }
    return dataclasses.replace(picture, channels=tuple(names.values()), **arrays)
