"""German of the demonstrations: a table of their texts, and a result with them in place of the English ones."""

from __future__ import annotations

import re
from dataclasses import replace

from looping_pendulum.teaching.demonstrations.demonstration import Demonstration, DemonstrationResult, judge_claim

_DECIMAL_POINT = re.compile(r"(?<=\d)\.(?=\d)")


def in_german(result: DemonstrationResult) -> DemonstrationResult:
    """Return a result whose texts are German, and whose numbers have a decimal comma."""
    demonstration = german_of(result.demonstration)
    judged = (judge_claim(claim, result.numbers) for claim in demonstration.claims)
    return replace(
        result,
        demonstration=demonstration,
        header=tuple(_said(cell) for cell in result.header),
        rows=tuple((_said(label), *(_said(cell, _with_comma(cell)) for cell in cells)) for label, *cells in result.rows),
        answer=tuple(replace(claim, text=_with_comma(claim.text)) for claim in judged),
        curves=tuple(replace(curve, label=_said(curve.label)) for curve in result.curves),
    )


def german_of(d: Demonstration) -> Demonstration:
    """Return a demonstration whose own texts are German."""
    lines, _, comment = d.change.partition("    # ")
    return replace(
        d,
        title=_said(d.title),
        question=_said(d.question),
        guess=_said(d.guess),
        experiment=_said(d.experiment),
        change=f"{lines}    # {_said(comment)}" if comment else lines,
        claims=tuple(replace(claim, words=_said(claim.words)) for claim in d.claims),
        picture=replace(d.picture, x=_said(d.picture.x), y=_said(d.picture.y), caption=_said(d.picture.caption)),
    )


def _said(text: str, otherwise: str | None = None) -> str:
    """Return the German of a text; of a demonstration that is not shipped it is not known."""
    return TEXTS.get(text, text if otherwise is None else otherwise)


def _with_comma(text: str) -> str:
    return _DECIMAL_POINT.sub(",", text)


TEXTS = {
    # Words that several share
    "run": "Bewegung",
    "reference": "Referenz",
    "never": "nie",
    "time [s]": "Zeit [s]",
    "M2 has fallen by [cm]": "Fallstrecke von M2 [cm]",
    "M1's height [cm]": "Höhe von M1 [cm]",
    "M2 halts at [s]": "Stillstand von M2 bei [s]",
    "M2 falls at most [cm]": "M2 fällt höchstens [cm]",
    "slips again [s]": "gleitet wieder [s]",
    "earlier by [ms]": "früher um [ms]",
    "M1 reaches the rod [s]": "M1 an der Stange [s]",
    # tendon-without-friction
    "A tendon without friction never halts": "Eine Sehne ohne Reibung hält nie an",
    "MuJoCo's tendon wraps round a cylinder. Is that enough for the heavy mass to be caught?": (
        "Die Sehne von MuJoCo umschlingt einen Zylinder. Genügt das, um die schwere Masse zu fangen?"
    ),
    "The tendon goes round the rod more and more often, so the heavy mass will be caught, a little later perhaps.": (
        "Die Sehne geht immer öfter um die Stange, also wird die schwere Masse gefangen, vielleicht etwas später."
    ),
    "The 10:1 trial, four times: the exact reference; MuJoCo's tendon as its documentation describes it; the "
    "same tendon, to which the adapter gives the friction that the capstan law allows; and the reference "
    "with the friction set to 0.": (
        "Der Versuch 10:1 viermal: die exakte Referenz; die Sehne von MuJoCo, wie seine Dokumentation sie "
        "beschreibt; dieselbe Sehne, der unsere Anbindung die Reibung gibt, die das Gesetz von Euler und "
        "Eytelwein zulässt; und die Referenz mit der Reibungszahl 0."
    ),
    "The heavy mass's way down. Without friction it comes up again and again; with friction it stays where it was caught.": (
        "Der Weg der schweren Masse nach unten. Ohne Reibung kommt sie immer wieder hoch; mit Reibung bleibt "
        "sie, wo sie gefangen wurde."
    ),
    "No. The reference halts at {halt[reference]:.3f} s; the tendon as documented turns round "
    "{turns[documented]} times within a second and never rests.": (
        "Nein. Die Referenz steht bei {halt[reference]:.3f} s still; die Sehne, wie dokumentiert, kehrt in einer "
        "Sekunde {turns[documented]}-mal um und ruht nie."
    ),
    "The solver is not to blame. Up to 0.35 s it is {off_slippery[documented]:.3f} mm from the reference "
    "without friction, and {off[documented]:.0f} mm from the reference: it solved another problem, and "
    "solved it well.": (
        "Am Löser liegt es nicht. Bis 0,35 s ist sie {off_slippery[documented]:.3f} mm von der Referenz ohne "
        "Reibung entfernt und {off[documented]:.0f} mm von der Referenz: Sie hat eine andere Aufgabe gelöst, und "
        "die gut."
    ),
    "Give the same tendon the friction that the capstan law allows, and it halts at {halt[capstan]:.3f} s. "
    "That tests MuJoCo's mechanics, not the law: the law was fed in.": (
        "Mit der Reibung, die das Gesetz von Euler und Eytelwein zulässt, steht dieselbe Sehne bei "
        "{halt[capstan]:.3f} s still. Das prüft die Mechanik von MuJoCo, nicht das Gesetz: Das Gesetz wurde "
        "eingegeben."
    ),
    "times M2 turned round": "wie oft M2 umkehrte",
    "M1 from the reference to 0.35 s [mm]": "M1 von der Referenz bis 0,35 s [mm]",
    "M1 from the reference without friction to 0.35 s [mm]": "M1 von der Referenz ohne Reibung bis 0,35 s [mm]",
    "MuJoCo, as documented": "MuJoCo, wie dokumentiert",
    "MuJoCo, capstan law fed in": "MuJoCo, Gesetz eingegeben",
    "reference without friction": "Referenz ohne Reibung",
    # constant-friction
    "Constant friction is not a capstan": "Gleichbleibende Reibung ist keine Seilreibung",
    "MuJoCo has a friction for tendons, a constant in newtons. Does one of the right size halt the heavy "
    "mass as the rod does?": (
        "MuJoCo hat eine Reibung für Sehnen, eine feste Zahl von Newton. Hält eine von der richtigen Größe die "
        "schwere Masse an, wie die Stange es tut?"
    ),
    "Friction is friction: with the right number it will come out about right.": (
        "Reibung ist Reibung: Mit der richtigen Zahl wird es etwa stimmen."
    ),
    "The reference, and MuJoCo's tendon with its own constant friction loss in three sizes that the "
    "reference itself suggests: its friction at the release, its mean over the way that the string slides, "
    "and its friction just before the halt.": (
        "Die Referenz, und die Sehne von MuJoCo mit ihrer eigenen gleichbleibenden Reibung in drei Größen, die "
        "die Referenz selbst nahelegt: ihre Reibung beim Loslassen, ihr Mittel über den Weg, den der Faden "
        "gleitet, und ihre Reibung kurz vor dem Stillstand."
    ),
    "The heavy mass's way down for the reference and three constants: two do not hold it, one is too strong to let it go.": (
        "Der Weg der schweren Masse nach unten für die Referenz und drei feste Größen: Zwei halten sie nicht, "
        "eine ist zu stark, um sie loszulassen."
    ),
    "None of the three. The small and the mean one never halt the heavy mass; the large one never lets it "
    "fall ({lowest[at_halt]:.1f} cm).": (
        "Keine der drei. Die kleine und die mittlere halten die schwere Masse nie an; die große lässt sie gar "
        "nicht fallen ({lowest[at_halt]:.1f} cm)."
    ),
    "The reference's friction is no constant: {first[reference]:.2f} N at the release, {last[reference]:.2f} "
    "N before the halt. The capstan law multiplies what the light mass pulls by exp(mu theta); as the light "
    "mass whips round, both its pull and the angle on the rod grow.": (
        "Die Reibung der Referenz bleibt nicht gleich: {first[reference]:.2f} N beim Loslassen, "
        "{last[reference]:.2f} N vor dem Stillstand. Das Gesetz von Euler und Eytelwein vervielfacht den Zug der "
        "leichten Masse mit exp(mu theta); während sie herumschwingt, wachsen ihr Zug und der Winkel auf der "
        "Stange."
    ),
    "constant friction [N]": "feste Reibung [N]",
    "true friction at release [N]": "wahre Reibung beim Loslassen [N]",
    "true friction before the halt [N]": "wahre Reibung vor dem Stillstand [N]",
    "constant: as at the release": "fest: wie beim Loslassen",
    "constant: the mean": "fest: das Mittel",
    "constant: as before the halt": "fest: wie vor dem Stillstand",
    "or 0.5: how does the friction at the halt grow?": "oder 0.5: Wie wächst die Reibung beim Stillstand?",
    # forgotten-turns
    "A tendon that forgets its turns": "Eine Sehne, die ihre Windungen vergisst",
    "A tendon wraps round a cylinder on the side that its side site names. What does it know after a full turn?": (
        "Eine Sehne umschlingt einen Zylinder auf der Seite, die ihr „side site“ nennt. Was weiß sie nach einer vollen Windung?"
    ),
    "The engine follows the string all the way round, as often as it likes.": (
        "Die Physik-Engine folgt dem Faden ganz herum, so oft er will."
    ),
    "The reference; MuJoCo's tendon with the capstan law, where the adapter counts the turns and uses two "
    "tendons in turn; and the same with one tendon for everything, which is what one side site gives.": (
        "Die Referenz; die Sehne von MuJoCo mit dem Gesetz von Euler und Eytelwein, bei der die Anbindung die "
        "Windungen zählt und zwei Sehnen im Wechsel nimmt; und dasselbe mit einer einzigen Sehne, wie ein „side "
        "site“ sie gibt."
    ),
    "The light mass's height. With one tendon it leaves the reference before the first turn is complete.": (
        "Die Höhe der leichten Masse. Mit einer Sehne verlässt sie die Referenz, bevor die erste Windung vollendet ist."
    ),
    "It knows nothing of turns: a tendon is the shortest way round at this instant. It follows the reference "
    "up to {apart[one]:.0f} deg of string on the rod; there another way becomes the shorter one, and without "
    "a warning its length is wrong by {stretch[one]:.0f} mm.": (
        "Sie weiß nichts von Windungen: Eine Sehne ist der kürzeste Weg herum in diesem Augenblick. Sie folgt "
        "der Referenz bis zu {apart[one]:.0f} Grad Faden auf der Stange; dort wird ein anderer Weg der kürzere, "
        "und ohne Warnung ist ihre Länge um {stretch[one]:.0f} mm falsch."
    ),
    "With the turns counted, the light mass is never 1 mm off and the length keeps to {stretch[counted]:.4f} mm.": (
        "Mit gezählten Windungen ist die leichte Masse nie 1 mm daneben, und die Länge stimmt auf {stretch[counted]:.4f} mm."
    ),
    "The one tendon cannot halt the heavy mass as the reference does at {halt[reference]:.3f} s: it says {halt[one]:.3f} s.": (
        "Die eine Sehne kann die schwere Masse nicht anhalten wie die Referenz bei {halt[reference]:.3f} s: Sie "
        "sagt {halt[one]:.3f} s."
    ),
    "string on the rod when M1 is 1 mm off [deg]": "Faden auf der Stange, wenn M1 1 mm daneben ist [Grad]",
    "largest error of the string's length [mm]": "größter Fehler der Fadenlänge [mm]",
    "turns counted, two tendons in turn": "Windungen gezählt, zwei Sehnen im Wechsel",
    "one tendon, turns forgotten": "eine Sehne, Windungen vergessen",
    "more turns before the light mass reaches the rod": "mehr Windungen, bevor die leichte Masse an der Stange ist",
    # polygon
    "A polygon is not a circle": "Ein Vieleck ist kein Kreis",
    "A chain of links over a rod is a polygon. Does it have the friction of a string over a circle?": (
        "Eine Kette aus Gliedern über einer Stange ist ein Vieleck. Hat sie die Reibung eines Fadens über einem Kreis?"
    ),
    "If the friction coefficient of the contact is right, the friction is right.": (
        "Stimmt die Reibungszahl des Kontakts, so stimmt die Reibung."
    ),
    "pymunk's beads slide over the rod with half a turn on it, contact friction 0.34. The two masses' "
    "accelerations give the tensions on either side, and so the exponent ln(T2 / T1), which for a string is "
    "mu theta. Links of four lengths, with the friction as it is, and corrected for the corners.": (
        "Die Perlen von pymunk gleiten mit einer halben Windung über die Stange, Reibungszahl des Kontakts 0,34. "
        "Die Beschleunigungen der beiden Massen geben die Fadenkräfte auf beiden Seiten und damit den Exponenten "
        "ln(T2 / T1), der für einen Faden mu theta ist. Glieder von vier Längen, mit der Reibung, wie sie ist, "
        "und berichtigt für die Ecken."
    ),
    "What corners add to the friction of a chain, by formula and as measured, and what is left after correcting for it.": (
        "Was Ecken zur Reibung einer Kette hinzufügen, nach der Formel und gemessen, und was nach der Berichtigung bleibt."
    ),
    "No. At a corner the chain presses on the rod more than a string does. With links bent by 46 deg the "
    "exponent is {error[b0.8]:.1f} % too large, with 23 deg {error[b0.4]:.1f} %, with 11 deg "
    "{error[b0.2]:.2f} %.": (
        "Nein. An einer Ecke drückt die Kette stärker auf die Stange als ein Faden. Bei Gliedern mit Knicken von "
        "46 Grad ist der Exponent um {error[b0.8]:.1f} % zu groß, bei 23 Grad um {error[b0.4]:.1f} %, bei 11 "
        "Grad um {error[b0.2]:.2f} %."
    ),
    "Half the link, a quarter of the error: from 46 to 23 deg it falls by a factor {error[b0.8]:.2f} / "
    "{error[b0.4]:.2f}. A closed form of a chain with corners tells all four, to a fifth.": (
        "Halbes Glied, ein Viertel des Fehlers: Von 46 auf 23 Grad fällt er um den Faktor {error[b0.8]:.2f} / "
        "{error[b0.4]:.2f}. Eine Formel für Ketten mit Ecken sagt alle vier voraus, auf ein Fünftel."
    ),
    "Once that is known, the contact's friction can be made smaller by as much: then {error[c0.8]:.2f} % are "
    "left at 46 deg and {error[c0.2]:.2f} % at 11 deg.": (
        "Ist das bekannt, lässt sich die Reibung des Kontakts um ebenso viel verkleinern: Dann bleiben "
        "{error[c0.8]:.2f} % bei 46 Grad und {error[c0.2]:.2f} % bei 11 Grad."
    ),
    "ln(T2 / T1)": "ln(T2 / T1)",
    "mu theta": "mu theta",
    "too large by [%]": "zu groß um [%]",
    "formula of a chain [%]": "Formel einer Kette [%]",
    "bend between two links on the rod [rad]": "Knick zwischen zwei Gliedern auf der Stange [rad]",
    "ln(T2 / T1) too large by [%]": "ln(T2 / T1) zu groß um [%]",
    "beads with friction mu": "Perlen mit Reibung mu",
    "beads, friction corrected for the corners": "Perlen, Reibung für die Ecken berichtigt",
    "formula: 2 N artanh(mu tan(theta / 2N))": "Formel: 2 N artanh(mu tan(theta / 2N))",
    "links bent by 11 deg": "Glieder mit Knicken von 11 Grad",
    "links bent by 23 deg": "Glieder mit Knicken von 23 Grad",
    "links bent by 46 deg": "Glieder mit Knicken von 46 Grad",
    "links bent by 69 deg": "Glieder mit Knicken von 69 Grad",
    "links bent by 11 deg, corrected": "Glieder mit Knicken von 11 Grad, berichtigt",
    "links bent by 23 deg, corrected": "Glieder mit Knicken von 23 Grad, berichtigt",
    "links bent by 46 deg, corrected": "Glieder mit Knicken von 46 Grad, berichtigt",
    "links bent by 69 deg, corrected": "Glieder mit Knicken von 69 Grad, berichtigt",
    "the same links bend half as much": "dieselben Glieder knicken halb so stark",
    # stretchy-solver
    "A stretchy solver": "Ein dehnbarer Löser",
    "The links of a chain have a fixed length. How long is the chain in a game engine that solves them one after the other?": (
        "Die Glieder einer Kette haben eine feste Länge. Wie lang ist die Kette in einer Physik-Engine für "
        "Spiele, die eines nach dem anderen löst?"
    ),
    "As long as the sum of its links: that is what a joint is for.": (
        "So lang wie die Summe ihrer Glieder: Dafür ist ein Gelenk da."
    ),
    "pymunk's beads along the whole string of the 10:1 trial, 100 ms from the release, in steps of 0.1 ms. "
    "The solver goes over all joints so and so many times per step. First more sweeps, then heavier beads.": (
        "Die Perlen von pymunk am ganzen Faden des Versuchs 10:1, 100 ms vom Loslassen an, in Schritten von 0,1 "
        "ms. Der Löser geht in jedem Schritt mehrere Male über alle Gelenke. Zuerst mehr Durchgänge, dann "
        "schwerere Perlen."
    ),
    "How much longer than its links the string is. Fewer sweeps and lighter beads make a softer spring.": (
        "Um wie viel länger als seine Glieder der Faden ist. Weniger Durchgänge und leichtere Perlen machen eine "
        "weichere Feder."
    ),
    "Longer. With 10 sweeps a step (the default) the string is {stretch[s10]:.0f} mm too long within a tenth "
    "of a second. A correction runs from joint to joint, and after a few sweeps it has not yet come from one "
    "end to the other: the chain is a spring.": (
        "Länger. Mit 10 Durchgängen je Schritt (wie voreingestellt) ist der Faden nach einer Zehntelsekunde "
        "{stretch[s10]:.0f} mm zu lang. Eine Berichtigung läuft von Gelenk zu Gelenk und ist nach wenigen "
        "Durchgängen noch nicht von einem Ende zum anderen gekommen: Die Kette ist eine Feder."
    ),
    "More sweeps stiffen it: {stretch[s30]:.1f} mm with 30; but even 100 leave {stretch[s100]:.1f} mm.": (
        "Mehr Durchgänge machen sie steifer: {stretch[s30]:.1f} mm mit 30; aber selbst 100 lassen {stretch[s100]:.1f} mm."
    ),
    "Heavier beads stiffen it as well: {stretch[m10]:.1f} mm and {stretch[m30]:.1f} mm with 10 sweeps. But a "
    "string of a third of the light mass is another apparatus than the one that was asked for.": (
        "Auch schwerere Perlen machen sie steifer: {stretch[m10]:.1f} mm und {stretch[m30]:.1f} mm mit 10 "
        "Durchgängen. Doch ein Faden mit einem Drittel der leichten Masse ist eine andere Anordnung als die "
        "gewünschte."
    ),
    "largest stretch [mm]": "größte Dehnung [mm]",
    "M1 from the reference [mm]": "M1 von der Referenz [mm]",
    "string too long by [mm]": "Faden zu lang um [mm]",
    "10 sweeps, string 1 % of M1": "10 Durchgänge, Faden 1 % von M1",
    "30 sweeps, string 1 % of M1": "30 Durchgänge, Faden 1 % von M1",
    "100 sweeps, string 1 % of M1": "100 Durchgänge, Faden 1 % von M1",
    "10 sweeps, string 10 % of M1": "10 Durchgänge, Faden 10 % von M1",
    "10 sweeps, string 30 % of M1": "10 Durchgänge, Faden 30 % von M1",
    "less to carry": "weniger zu tragen",
    # creeping-friction
    "A regularised friction creeps": "Geglättete Reibung kriecht",
    "A string that sticks does not move. Does a simulated one?": (
        "Ein Faden, der haftet, bewegt sich nicht. Ein simulierter auch nicht?"
    ),
    "Once the heavy mass is caught it stands still.": "Ist die schwere Masse gefangen, steht sie still.",
    "MuJoCo's friction is softened: the friction force is a smooth function of the sliding speed, so what is "
    "held must slide a little to be held. Two numbers set how much, a time constant and an impedance. The "
    "tendon with the capstan law, with both made hard, with the default time constant of 20 ms, and with "
    "both as they come. Creep is measured from 0.45 to 1 s, when the reference's string holds.": (
        "Die Reibung von MuJoCo ist geglättet: Die Reibungskraft hängt stetig von der Geschwindigkeit des "
        "Gleitens ab, so dass etwas gleiten muss, um gehalten zu werden. Wie sehr, bestimmen zwei Zahlen, eine "
        "Zeitkonstante und eine Impedanz. Die Sehne mit dem Gesetz von Euler und Eytelwein, mit beiden hart, mit "
        "der voreingestellten Zeitkonstante von 20 ms, und mit beiden, wie sie sind. Das Kriechen wird von 0,45 "
        "bis 1 s gemessen, wenn der Faden der Referenz hält."
    ),
    "The heavy mass after it was caught. Softened friction lets it creep up; the reference stands still.": (
        "Die schwere Masse, nachdem sie gefangen wurde. Geglättete Reibung lässt sie nach oben kriechen; die "
        "Referenz steht still."
    ),
    "With the settings as they come it does not stand still, and so it never halts: the light mass, still "
    "whipping round, pulls it up by {creep[soft]:.1f} mm while it is held; the reference's string moves by "
    "{creep[reference]:.5f} mm.": (
        "Mit den Einstellungen, wie sie sind, steht sie nicht still: Die leichte Masse, die noch herumschwingt, "
        "zieht sie um {creep[soft]:.1f} mm hoch, während sie gehalten wird; der Faden der Referenz bewegt sich "
        "um {creep[reference]:.5f} mm."
    ),
    "The time constant alone makes the halt {late[slow]:.0f} ms late.": (
        "Die Zeitkonstante allein verspätet den Stillstand um {late[slow]:.0f} ms."
    ),
    "Hard settings bring the creep down to {creep[hard]:.5f} mm and the halt to {late[hard]:.3f} ms.": (
        "Harte Einstellungen bringen das Kriechen auf {creep[hard]:.5f} mm und den Stillstand auf {late[hard]:.3f} ms."
    ),
    "late by [ms]": "zu spät um [ms]",
    "creeps while held [mm]": "kriecht, während sie gehalten wird [mm]",
    "M2 above its lowest point [mm]": "M2 über dem tiefsten Punkt [mm]",
    "1 ms, hard": "1 ms, hart",
    "20 ms, hard": "20 ms, hart",
    "20 ms, soft (as it comes)": "20 ms, weich (wie voreingestellt)",
    "the string is held less tightly: does it creep more?": "Der Faden wird weniger fest gehalten: Kriecht er mehr?",
    # drag-and-spiral
    "Drag makes the spiral right": "Luftwiderstand macht die Spirale richtig",
    "After the halt the light mass winds in on a spiral. The air's drag on 10 g is tiny: may it be left out?": (
        "Nach dem Stillstand wickelt sich die leichte Masse auf einer Spirale ein. Der Luftwiderstand an 10 g "
        "ist winzig: Darf er wegbleiben?"
    ),
    "A drag of a few 1e-4 kg/m changes nothing that one could see on a video.": (
        "Ein Luftwiderstand von einigen 0,1 g/m ändert nichts, was man auf einem Film sähe."
    ),
    "The exact reference of the 10:1 trial without drag, with the drag that the scenario has, and with twice "
    "that. The path after the halt is held against the closed-form spiral, l + R theta = constant; the times "
    "against each other.": (
        "Die exakte Referenz des Versuchs 10:1 ohne Luftwiderstand, mit dem des Szenarios und mit dem doppelten. "
        "Der Weg nach dem Stillstand wird mit der Spirale der Formel verglichen, l + R theta bleibt gleich; die "
        "Zeiten miteinander."
    ),
    "The light mass's height. The three agree up to the halt; then less drag runs ahead, loop by loop.": (
        "Die Höhe der leichten Masse. Bis zum Stillstand stimmen die drei überein; dann eilt weniger "
        "Luftwiderstand voraus, Schlinge um Schlinge."
    ),
    "The shape of the spiral knows nothing of drag: with and without it the path is the closed form's, to "
    "{spiral[declared]:.0e} mm and {spiral[none]:.0e} mm.": (
        "Die Form der Spirale weiß nichts vom Luftwiderstand: Mit ihm und ohne ihn ist der Weg der der Formel, "
        "auf {spiral[declared]:.0e} mm und {spiral[none]:.0e} mm."
    ),
    "The clock does. Without drag the light mass reaches the rod {earlier[none]:.1f} ms earlier, which is "
    "more than 5 frames at 240 a second, and is {apart[none]:.0f} mm from where it should be (root mean "
    "square to 1.0 s).": (
        "Die Uhr schon. Ohne Luftwiderstand ist die leichte Masse {earlier[none]:.1f} ms früher an der Stange, "
        "was mehr als 5 Bilder bei 240 je Sekunde sind, und {apart[none]:.0f} mm von dort, wo sie sein sollte "
        "(quadratisches Mittel bis 1,0 s)."
    ),
    "The halt hardly tells: it moves by {halt_earlier[none]:.1f} ms, less than one frame. So a model that is "
    "right up to the halt may still lack the drag.": (
        "Der Stillstand verrät es kaum: Er verschiebt sich um {halt_earlier[none]:.1f} ms, weniger als ein Bild. "
        "So kann einem Modell, das bis zum Stillstand stimmt, doch der Luftwiderstand fehlen."
    ),
    "halts earlier by [ms]": "Stillstand früher um [ms]",
    "M1 from the declared run to 1.0 s [mm]": "M1 von der angegebenen Bewegung bis 1,0 s [mm]",
    "path off the closed-form spiral [mm]": "Weg neben der Spirale der Formel [mm]",
    "free length off the formula without gravity and drag [mm]": (
        "freie Länge neben der Formel ohne Schwere und Luftwiderstand [mm]"
    ),
    "drag as in the scenario": "Luftwiderstand wie im Szenario",
    "no drag": "kein Luftwiderstand",
    "twice the drag": "doppelter Luftwiderstand",
    # break-away
    "Static against kinetic friction at the break-away": "Haftreibung und Gleitreibung beim Losreißen",
    "A resting string grips better than a sliding one. When does that matter?": (
        "Ein ruhender Faden haftet besser, als ein gleitender bremst. Wann macht das etwas aus?"
    ),
    "A better grip makes everything stop earlier.": "Bessere Haftung hält alles früher an.",
    "The exact reference of the 2:1 trial, where the string sticks, slips again and sticks for good, with a "
    "static friction 1, 1.2 and 1.5 times the kinetic one.": (
        "Die exakte Referenz des Versuchs 2:1, in dem der Faden haftet, wieder gleitet und endgültig haftet, mit "
        "einer Haftreibung, die 1, 1,2 und 1,5 mal so groß ist wie die Gleitreibung."
    ),
    "The heavy mass's way down for three static frictions: nothing differs until the string first rests.": (
        "Der Weg der schweren Masse nach unten für drei Haftreibungen: Nichts ist verschieden, bis der Faden zum "
        "ersten Mal ruht."
    ),
    "While the string slides, static friction does nothing: all three come to their first stop at {stop[r1.0]:.4f} s.": (
        "Solange der Faden gleitet, tut die Haftreibung nichts: Alle drei halten zum ersten Mal bei {stop[r1.0]:.4f} s an."
    ),
    "At 1.2 it only delays the break-away, from {away[r1.0]:.4f} s to {away[r1.2]:.4f} s.": (
        "Bei 1,2 verzögert sie nur das Losreißen, von {away[r1.0]:.4f} s auf {away[r1.2]:.4f} s."
    ),
    "At 1.5 the story is another one: the string already holds at the first stop ({stick[r1.5]:.4f} s), "
    "where before it ran back, and the heavy mass falls {lowest[r1.5]:.1f} cm at most instead of "
    "{lowest[r1.0]:.1f} cm. A threshold, not a gradual change: a fit that follows slopes cannot see it "
    "coming.": (
        "Bei 1,5 geht es anders: Der Faden hält schon beim ersten Halt ({stick[r1.5]:.4f} s), wo er vorher "
        "zurücklief, und die schwere Masse fällt höchstens {lowest[r1.5]:.1f} cm statt {lowest[r1.0]:.1f} cm. "
        "Eine Schwelle, keine allmähliche Änderung: Eine Anpassung, die Steigungen folgt, kann sie nicht kommen "
        "sehen."
    ),
    "first stop [s]": "erster Halt [s]",
    "sticks first [s]": "haftet zuerst [s]",
    "static / kinetic = 1": "Haftreibung / Gleitreibung = 1",
    "static / kinetic = 1.2": "Haftreibung / Gleitreibung = 1,2",
    "static / kinetic = 1.5": "Haftreibung / Gleitreibung = 1,5",
    "found by trial: where does the motion change?": "durch Probieren gefunden: Wo ändert sich die Bewegung?",
    # string-on-string
    "The string that winds on itself": "Der Faden, der sich auf sich selbst wickelt",
    "After a full turn the string lies on string, which grips better than the rod, and makes it thicker. Does it matter?": (
        "Nach einer vollen Windung liegt Faden auf Faden, der besser haftet als die Stange und sie dicker macht. "
        "Macht das etwas aus?"
    ),
    "Better grip and a thicker rod stop the heavy mass earlier.": (
        "Bessere Haftung und eine dickere Stange halten die schwere Masse früher an."
    ),
    "The exact reference, with a friction of 0.1 per radian added where string lies on string, and with a "
    "string that makes the rod 0.5 mm thicker per turn; on the rod of the 10:1 trial and on a slippery one "
    "(friction 0.05).": (
        "Die exakte Referenz, mit einer zusätzlichen Reibung von 0,1 je Radiant, wo Faden auf Faden liegt, und "
        "mit einem Faden, der die Stange je Windung 0,5 mm dicker macht; an der Stange des Versuchs 10:1 und an "
        "einer glatten (Reibungszahl 0,05)."
    ),
    "The heavy mass's way down. On the rod of the trial the lines lie on one another; on the slippery rod "
    "string on string makes the difference.": (
        "Der Weg der schweren Masse nach unten. An der Stange des Versuchs liegen die Linien aufeinander; an der "
        "glatten Stange macht Faden auf Faden den Unterschied."
    ),
    "In the 10:1 trial the grip of string on string does nothing: the heavy mass halts with "
    "{angle[plain]:.0f} deg of string on the rod, before the first turn is complete.": (
        "Im Versuch 10:1 tut die Haftung von Faden auf Faden nichts: Die schwere Masse steht mit "
        "{angle[plain]:.0f} Grad Faden auf der Stange still, bevor die erste Windung vollendet ist."
    ),
    "On a slippery rod it decides the end: without it the string first holds at {stick[slippery]:.3f} s and "
    "slips again at {away[slippery]:.3f} s; with it, it holds for good from {halt[slippery_grip]:.3f} s on, "
    "{angle[slippery_grip]:.0f} deg being on the rod.": (
        "An einer glatten Stange entscheidet sie das Ende: Ohne sie hält der Faden zuerst bei "
        "{stick[slippery]:.3f} s und gleitet bei {away[slippery]:.3f} s wieder; mit ihr hält er ab "
        "{halt[slippery_grip]:.3f} s endgültig, mit {angle[slippery_grip]:.0f} Grad auf der Stange."
    ),
    "The thickness does not move the halt, but what follows: string is used up faster on a thicker rod, and "
    "the light mass arrives {earlier[thick]:.0f} ms earlier.": (
        "Die Dicke verschiebt nicht den Stillstand, aber was folgt: Auf einer dickeren Stange ist der Faden "
        "schneller verbraucht, und die leichte Masse kommt {earlier[thick]:.0f} ms früher an."
    ),
    "string first holds [s]": "Faden hält zuerst [s]",
    "string on the rod at the halt [deg]": "Faden auf der Stange beim Stillstand [Grad]",
    "10:1 trial": "Versuch 10:1",
    "string grips string": "Faden haftet auf Faden",
    "string thickens the rod": "Faden verdickt die Stange",
    "slippery rod": "glatte Stange",
    "slippery rod, string grips string": "glatte Stange, Faden haftet auf Faden",
}
"""English text of a demonstration -> the German one, with the same numbers to be filled in."""
