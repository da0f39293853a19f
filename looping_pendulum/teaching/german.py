"""German of what the package writes in English about runs: engines' captions, where and why they depart, words of the glossary.

A text is translated piece by piece, and only if every piece is known: what engines outside this package say of themselves
stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache

_NUMBER = r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?: (?:[nµm]?m|[nµm]?s|[µm]?m/s|°|rad|%))?(?![\w/])"

PIECES = {
    "{n}": "{0}",
    **{mark: mark for mark in (" ", ". ", ".", ", ", "; ", ": ", " (", ")")},
    " and ": " und ",
    " or ": " oder ",
    # Captions
    "The exact model, solved far more finely than any engine": ("Das exakte Modell, weit feiner gelöst als jede Physik-Engine"),
    "It never halts": "Sie kommt nie zum Stillstand",
    "It halts at {n}": "Sie steht bei {0} endgültig still",
    "Not shown to the end": "Nicht bis zum Ende zu sehen",
    "Nothing to show": "Nichts zu sehen",
    "Friction plays no part here": "Reibung spielt hier keine Rolle",
    "It does not say who supplies the friction": "Von wem die Reibung kommt, ist nicht angegeben",
    "Friction by the engine itself": "Reibung von der Physik-Engine selbst",
    "Friction fed in by our adapter": "Reibung von unserer Anbindung eingegeben",
    "No friction on the rod": "Keine Reibung an der Stange",
    "Halts at {n}, {n} after the reference": "Stillstand bei {0}, {1} nach der Referenz",
    "Halts at {n}, {n} before the reference": "Stillstand bei {0}, {1} vor der Referenz",
    "Comes to rest at {n}; the reference never does": "Kommt bei {0} zur Ruhe, die Referenz nie",
    "Its run ends at {n}, before the reference halts": "Die Bewegung endet bei {0}, vor dem Stillstand der Referenz",
    "Does not halt by {n}": "Bis {0} kein Stillstand",
    "RMS distance of its path until the halt: {n}": "Abstand des Weges (RMS) bis zum Stillstand: {0}",
    "RMS distance of its path until {n}: {n}": "Abstand des Weges (RMS) bis {0}: {1}",
    "RMS distance of the measured points": "Abstand der Messpunkte (RMS)",
    "light mass {n}": "leichte Masse {0}",
    "heavy mass {n}": "schwere Masse {0}",
    "Lacks ": "Es fehlt: ",
    "No physics is declared missing": "Keine Physik ist als fehlend angegeben",
    # Who supplies the friction, and how
    "capstan bound from the tendon's tension, fed to dof_frictionloss": (
        "Grenze nach Euler und Eytelwein aus der Spannkraft der Sehne, eingegeben als dof_frictionloss"
    ),
    "heavy mass times exp(sign(v2) mu theta), which is the capstan law while it slides": (
        "schwere Masse mal exp(sign(v2) mu theta), was beim Gleiten das Gesetz von Euler und Eytelwein ist"
    ),
    "Coulomb contact at every node": "Coulombscher Kontakt an jedem Knoten",
    "the adapter solves its coefficient from the capstan law for the polygon's corners": (
        "die Anbindung bestimmt die Reibungszahl aus dem Gesetz von Euler und Eytelwein für die Ecken des Vielecks"
    ),
    "Coulomb friction between beads and circle": "Coulombsche Reibung zwischen Perlen und Kreis",
    "Coulomb friction between beads and cylinder": "Coulombsche Reibung zwischen Perlen und Zylinder",
    "Coulomb friction between beads and sphere": "Coulombsche Reibung zwischen Perlen und Kugel",
    "Coulomb friction between segments and circle": "Coulombsche Reibung zwischen Gliedern und Kreis",
    "its coefficient solved from the capstan law for the polygon's corners": (
        "die Reibungszahl bestimmt aus dem Gesetz von Euler und Eytelwein für die Ecken des Vielecks"
    ),
    "its coefficient solved for their corners": "die Reibungszahl bestimmt für ihre Ecken",
    "uncorrected": "nicht berichtigt",
    "capstan law, T2 = T1 exp(-sign(v2) mu theta)": "Gesetz von Euler und Eytelwein, T2 = T1 exp(-sign(v2) mu theta)",
    "constant frictionloss of the hanging part's tendon, whatever its load; its size is the adapter's": (
        "gleichbleibender Reibungsverlust der Sehne des hängenden Teils bei jeder Last; seine Größe ist von der Anbindung"
    ),
    "the capstan law of the roller, up to half a turn": (
        "das Gesetz von Euler und Eytelwein der Rolle, bis zu einer halben Windung"
    ),
    "a reeving system's tension is the same on both sides of a sheave": (
        "die Spannkraft eines Seilzugs ist auf beiden Seiten einer Scheibe dieselbe"
    ),
    "spatial tendons have no friction on what they wrap": ("räumliche Sehnen haben keine Reibung an dem, was sie umschlingen"),
    "by closed form": "durch eine Formel",
    # How a run ended
    "ran for the scenario's whole duration": "lief über die ganze Dauer des Szenarios",
    "ran until the light mass reached the rod": "lief, bis die leichte Masse an der Stange war",
    "the string's length left its budget; raise solver iterations or shorten the time step": (
        "die Länge des Fadens verließ ihre Grenzen; mehr Schritte des Lösers oder ein kürzerer Zeitschritt helfen"
    ),
    "a position became infinite or not a number; shorten the time step": (
        "ein Ort wurde unendlich oder keine Zahl; ein kürzerer Zeitschritt hilft"
    ),
    "a mass flew farther from the rod than its string reaches; shorten the time step or raise solver iterations": (
        "eine Masse flog weiter von der Stange, als der Faden reicht; ein kürzerer Zeitschritt oder mehr "
        "Schritte des Lösers helfen"
    ),
    "stopped by its time limit; raise --time-limit or use --profile quick": (
        "an der Zeitgrenze beendet; --time-limit erhöhen oder --profile quick nehmen"
    ),
    "stopped by its memory limit; raise --memory-limit or use --profile quick": (
        "an der Speichergrenze beendet; --memory-limit erhöhen oder --profile quick nehmen"
    ),
    "the engine's process died; its output says more": "der Prozess der Physik-Engine brach ab; seine Ausgabe sagt mehr",
    "the engine raised an error": "die Physik-Engine meldete einen Fehler",
    "the engine is not installed; `looping-pendulum engines` says how to get it": (
        "die Physik-Engine ist nicht installiert; `looping-pendulum engines` sagt, woher es sie gibt"
    ),
    "the engine cannot represent this scenario": "die Physik-Engine kann dieses Szenario nicht darstellen",
    "interrupted by the user; what was computed is kept": "unterbrochen; was berechnet ist, bleibt",
    # How to get an engine, and on which systems that works
    "get it: {c}": "zu haben mit: {0}",
    "Linux, from glibc 2.34 on; on a Mac with an ARM processor from Python 3.12 on; not on Windows": (
        "Linux ab glibc 2.34; auf einem Mac mit ARM-Prozessor ab Python 3.12; nicht auf Windows"
    ),
    "Linux, Macs with an ARM processor, and Windows on x86-64": "Linux, Macs mit ARM-Prozessor und Windows auf x86-64",
    "all systems but Windows on ARM": "alle Systeme außer Windows auf ARM",
    "all systems but Macs with an Intel processor": "alle Systeme außer Macs mit Intel-Prozessor",
    "all systems but Macs with an Intel processor, and Linux on ARM with a glibc before 2.34": (
        "alle Systeme außer Macs mit Intel-Prozessor und Linux auf ARM mit einer glibc vor 2.34"
    ),
    "Linux only; SciPy replaces it everywhere else": "nur Linux; anderswo nimmt SciPy seine Stelle ein",
    "Linux on x86-64 with Python 3.11 only; elsewhere pip compiles it for many minutes, which needs a C++ compiler": (
        "nur Linux auf x86-64 mit Python 3.11; anderswo übersetzt pip es viele Minuten lang, was einen C++-Compiler braucht"
    ),
    # Where, when and why
    "No motion to compare": "Keine Bewegung zum Vergleichen",
    "Stays within 1 mm of the reference up to {n}, where the comparison ends": (
        "Bleibt bis {0}, wo der Vergleich endet, auf 1 mm bei der Referenz"
    ),
    "First deviates by more than {n} at {n}, while ": "Weicht bei {1} zum ersten Mal um mehr als {0} ab; dabei: ",
    ", {n} after the release": ", {0} nach dem Loslassen",
    ", {n} after a stop of the heavy mass": ", {0} nach einem Halt der schweren Masse",
    ", {n} after the string began to stick": ", {0} nach dem Beginn des Haftens",
    ", {n} after the halt": ", {0} nach dem Stillstand",
    ", {n} after the string began to slide again": ", {0} nach dem Beginn des neuen Gleitens",
    ", {n} after the string fell slack": ", {0} nach dem Schlaffwerden des Fadens",
    ", {n} after the string became taut again": ", {0} nach dem Straffwerden des Fadens",
    ", {n} after the light mass reached the rod": ", {0} nach der Ankunft der leichten Masse an der Stange",
    ", {n} after the heavy mass reached the rod": ", {0} nach der Ankunft der schweren Masse an der Stange",
    ", {n} after the string left the rod": ", {0} nach dem Ablösen des Fadens von der Stange",
    "; by more than {n} at {n}": "; bei {1} um mehr als {0}",
    "At that time its light mass is {n} ": "Dann ist die leichte Masse {0} ",
    "further out along the string and {n} ": "weiter außen am Faden und quer dazu {0} ",
    "further in along the string and {n} ": "weiter innen am Faden und quer dazu {0} ",
    "ahead across it, and its heavy mass is {n} ": "voraus, und die schwere Masse ist {0} ",
    "behind across it, and its heavy mass is {n} ": "zurück, und die schwere Masse ist {0} ",
    "At that time its heavy mass is {n} ": "Dann ist die schwere Masse {0} ",
    "higher than the reference's": "höher als in der Referenz",
    "lower than the reference's": "tiefer als in der Referenz",
    "Likely cause": "Wahrscheinliche Ursache",
    "neither the engine nor the adapter models ": "weder Physik-Engine noch Anbindung bilden nach: ",
    ", which this scenario has": ", was dieses Szenario hat",
    "its string had stretched by up to {n} by then": "der Faden hatte sich bis dahin um bis zu {0} gedehnt",
    "All the physics that had acted by then is modelled": "Alle Physik, die bis dahin wirkte, ist nachgebildet",
    "All the physics of the scenario is modelled": "Alle Physik des Szenarios ist nachgebildet",
    "by the engine: ": "durch die Physik-Engine: ",
    "by the adapter: ": "durch die Anbindung: ",
    ", and its string did not stretch": ", und der Faden hat sich nicht gedehnt",
    ", and its string had stretched by no more than {n}": ", und der Faden hatte sich höchstens um {0} gedehnt",
    "Suspect its time step, its solver or a coefficient": "Verdächtig sind Zeitschritt, Löser oder eine Reibungszahl",
    "Its halt is not comparable": "Der Stillstand ist nicht vergleichbar",
    "the run ends at {n}, when its string rests; the reference's rests then too, but slides again later": (
        "die Bewegung endet bei {0}, wenn der Faden ruht; der der Referenz ruht dann auch, gleitet aber später wieder"
    ),
    "the run ends at {n}, before the reference halts at {n}": (
        "die Bewegung endet bei {0}, vor dem Stillstand der Referenz bei {1}"
    ),
    "the run ends at {n}, less than {n} after the reference halts at {n}": (
        "die Bewegung endet bei {0}, weniger als {1} nach dem Stillstand der Referenz bei {2}"
    ),
    "its string rests from {n} to the end of the run": "der Faden ruht von {0} bis zum Ende der Bewegung",
    "Its heavy mass comes to rest at {n}; the reference's never does": (
        "Die schwere Masse kommt bei {0} zur Ruhe, die der Referenz nie"
    ),
    "Its light mass reaches the rod at {n}, before the reference's heavy mass halts ({n})": (
        "Die leichte Masse ist bei {0} an der Stange, bevor die schwere der Referenz stillsteht ({1})"
    ),
    "Its heavy mass does not halt": "Die schwere Masse kommt nicht zum Stillstand",
    " to within {n}": ", auf {0} genau,",
    " (the reference's halts at {n})": " (die der Referenz bei {0})",
    "; it stops at ": "; sie hält an bei ",
    " and moves on": " und bewegt sich weiter",
    "Halts {n} late": "Stillstand {0} zu spät",
    "Halts {n} early": "Stillstand {0} zu früh",
    "Halts on time": "Stillstand zur rechten Zeit",
    ", uncertain by {n}, by what counts as rest": ", unsicher um {0} durch das, was als Ruhe gilt",
    ", uncertain by at least {n}, by what counts as rest": ", unsicher um mindestens {0} durch das, was als Ruhe gilt",
    " (at rest until the run ends at {n})": " (in Ruhe bis zum Ende der Bewegung bei {0})",
    "After its first rest it still moves by {n}, at up to {n}": (
        "Nach der ersten Ruhe bewegt sie sich noch um {0}, mit bis zu {1}"
    ),
    "It has one friction coefficient where this scenario has two ({n} before it slides, {n} while it does): "
    "its run lacks the static one": (
        "Es gibt nur eine Reibungszahl, wo dieses Szenario zwei hat ({0} vor dem Gleiten, {1} dabei): Die Haftreibung fehlt"
    ),
    "The run broke off at {n}": "Die Bewegung brach bei {0} ab",
    # Physics, events and modes
    "the winding": "das Aufwickeln",
    "the string's friction on the rod": "die Reibung des Fadens an der Stange",
    "sticking and slipping": "Haften und Gleiten",
    "the drag": "der Luftwiderstand",
    "a static friction other than the kinetic one": "eine Haftreibung, die anders als die Gleitreibung ist",
    "the release": "das Loslassen",
    "a stop of the heavy mass": "ein Halt der schweren Masse",
    "the string began to stick": "der Faden haftet",
    "the halt": "der Stillstand",
    "the string began to slide again": "der Faden gleitet wieder",
    "the string fell slack": "der Faden wurde schlaff",
    "the string became taut again": "der Faden wurde wieder straff",
    "the light mass reached the rod": "die leichte Masse ist an der Stange",
    "the heavy mass reached the rod": "die schwere Masse ist an der Stange",
    "the string left the rod": "der Faden löste sich von der Stange",
    "the string sticks to the rod": "der Faden haftet an der Stange",
    "the string sticks to the rod, which turns": "der Faden haftet an der Stange, die sich dreht",
    "the string slides and the heavy mass falls": "der Faden gleitet, und die schwere Masse fällt",
    "the string slides and the heavy mass rises": "der Faden gleitet, und die schwere Masse steigt",
    "the string is slack": "der Faden ist schlaff",
    "the light mass swings and the heavy one is clamped": "die leichte Masse schwingt, die schwere ist festgehalten",
    "the string is slack and the heavy mass clamped": "der Faden ist schlaff, die schwere Masse festgehalten",
    "both masses fall freely": "beide Massen fallen frei",
    "the reference ends": "die Referenz endet",
    "the mode of the reference is unknown": "was der Faden der Referenz tut, ist nicht bekannt",
}
"""Piece of an English text -> the German one; {n} is a number with its unit, {c} a command, {0} the first of them."""

GLOSSARY = {
    "light mass": (
        "leichte Masse",
        "Die kleine Masse, die um die Stange kreist.",
    ),
    "heavy mass": (
        "schwere Masse",
        "Die große Masse, die fällt, bis der aufgewickelte Faden sie hält.",
    ),
    "reference": (
        "Referenz",
        "Das exakte mathematische Modell der Anordnung, weit feiner gelöst als jede Physik-Engine; nicht der "
        "gemessene Versuch.",
    ),
    "engine": (
        "Physik-Engine",
        "Ein allgemeines Programm für Simulationen (pymunk, MuJoCo, PyBullet, ...), in dem dieselbe Anordnung gebaut wurde.",
    ),
    "deviation": (
        "Abweichung",
        "Wie weit die leichte Masse einer Physik-Engine zur selben Zeit von der der Referenz entfernt ist.",
    ),
    "root mean square (RMS)": (
        "quadratisches Mittel (RMS)",
        "Die typische Größe vieler Werte: quadrieren, mitteln, die Wurzel ziehen.",
    ),
    "tube": (
        "Schlauch",
        "Ein Punkt liegt darin, wenn die Referenz ihm auf 5 mm nahe kommt, 5 ms früher oder später: Eine kleine "
        "Verspätung schadet nicht.",
    ),
    "free length": (
        "freie Länge",
        "Das gerade Stück des Fadens von der Stange bis zur leichten Masse.",
    ),
    "wrap angle": (
        "Umschlingungswinkel",
        "Wie viel Faden auf der Stange liegt, als Winkel: Er wächst mit jeder Schlinge der leichten Masse um 6,28 rad.",
    ),
    "drop": (
        "Fallstrecke",
        "Wie weit die schwere Masse unter dem Ort ist, an dem sie losgelassen wurde.",
    ),
    "stop": (
        "Halt",
        "Die Geschwindigkeit der schweren Masse ist null, und sei es für einen Augenblick.",
    ),
    "slip onset": (
        "Beginn des Gleitens",
        "Die Stange kann den Faden nicht mehr halten: Ein ruhender Faden gleitet wieder.",
    ),
    "halting time": (
        "Zeit des Stillstands",
        "Wann der Faden aufhört, über die Stange zu gleiten, und nicht wieder um mehr als 0,1 mm gleitet, bis "
        "die leichte Masse an der Stange ist oder die Bewegung endet. Sie wird aus Punkten im Abstand von einer "
        "Millisekunde abgelesen, für Referenz und Physik-Engines gleich.",
    ),
    "halting-time uncertainty": (
        "Unsicherheit des Stillstands",
        "Um wie viel sich die Zeit des Stillstands verschiebt, wenn die 0,1 mm ein Viertel größer oder kleiner "
        "genommen werden.",
    ),
    "rebound": (
        "Nachgeben",
        "Was der Faden sich noch bewegt, nachdem er auf 1 mm zur Ruhe gekommen ist: wie weit, und wie schnell höchstens.",
    ),
    "not comparable": (
        "nicht vergleichbar",
        "Eine von zwei Bewegungen wurde nicht lange genug verfolgt, um zu haben, was die andere hat, oder zu "
        "zeigen, dass sie es nicht hat.",
    ),
    "lacks": (
        "fehlt",
        "Physik, die das Szenario hat und die Bewegung der Physik-Engine nicht, wie ihre Anbindung angibt.",
    ),
    "slack": (
        "schlaff",
        "Der Faden überträgt keine Kraft: Beide Massen fliegen frei, bis er wieder straff ist.",
    ),
    "capstan law": (
        "Gesetz von Euler und Eytelwein",
        "Ein aufgewickelter Faden hält eine Spannkraft, die exponentiell mit dem Umschlingungswinkel wächst: T2 "
        "= T1 exp(mu theta).",
    ),
    "stretch": (
        "Dehnung",
        "Um wie viel länger als in Ruhe die Physik-Engine den Faden werden ließ; der der Referenz dehnt sich nicht.",
    ),
    "growth rate": (
        "Wachstumsrate",
        "Wie schnell eine Abweichung von 1 auf 10 mm wuchs, als Rate einer Exponentialfunktion; groß: kleine "
        "Fehler machen viel aus.",
    ),
    "expected failure": (
        "erwartete Abweichung",
        "Eine Grenze, von der bekannt ist, dass die Physik-Engine sie nicht einhält, mit angegebenem Grund; wird "
        "sie eingehalten, ist auch das ein Fehler.",
    ),
}
"""English term -> German term and meaning."""


def german_of(texts: Iterable[str]) -> dict[str, str]:
    """Return those of the texts that can be said in German, each with its German."""
    known = {text: translated(text) for text in texts if text}
    return {text: german for text, german in known.items() if german is not None}


@cache
def _patterns() -> list[tuple[re.Pattern[str], str]]:
    """Return patterns of all pieces with their German."""
    compiled = []
    for piece, german in PIECES.items():
        pattern = re.escape(piece).replace(r"\{n\}", f"({_NUMBER})").replace(r"\{c\}", "(`[^`]+`)")
        compiled.append((re.compile(pattern), german))
    return compiled


def translated(text: str) -> str | None:
    """Return a text in German; None: it has pieces that are not known."""
    done, place = "", 0
    while place < len(text):
        matches = [(match, german) for pattern, german in _patterns() if (match := pattern.match(text, place))]
        if not matches:
            return None
        match, german = max(matches, key=lambda one: one[0].end())
        done += german.format(*(part if part.startswith("`") else part.replace(".", ",") for part in match.groups()))
        place = match.end()
    return done
