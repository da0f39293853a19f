"""axe-core on a page: which of its rules the page breaks."""

from functools import cache
from importlib.resources import files
from typing import Any

RULES = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")

RUN = """async (rules) => {
  const { violations, passes } = await axe.run(document, { runOnly: rules, resultTypes: ["violations"] });
  const words = (id) => ({ target, failureSummary }) => `${id}: ${target}: ${failureSummary}`;
  return { broken: violations.flatMap(({ id, nodes }) => nodes.map(words(id))), passed: passes.length };
}"""


@cache
def _source() -> str:
    return (files("axe_playwright_python") / "axe.min.js").read_text(encoding="utf-8")


def violations(page: Any) -> list[str]:
    """Return what breaks a rule on ``page``, as it is now."""
    # Evaluated by the browser's own tools, which the page's security policy does not bind
    if not page.evaluate("typeof axe === 'object'"):
        page.evaluate(_source())
    result = page.evaluate(RUN, list(RULES))
    assert result["passed"] > 20, "axe-core found hardly anything to look at"
    broken: list[str] = result["broken"]
    return broken
