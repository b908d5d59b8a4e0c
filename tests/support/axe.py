"""axe, which looks for what keeps readers with a disability out of a page."""

from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from playwright.sync_api import Page

# Rules about colours and room: what a theme or a width can break.
LOOKS = ("color-contrast", "link-in-text-block", "scrollable-region-focusable", "target-size")


def violations(page: Page, rules: Sequence[str] = ()) -> list[str]:
    """Each rule that the page breaks, or of some: its name, what it asks for, and the elements that break it.

    The script is evaluated from outside, as the policy of our pages admits no script but their own.
    """
    page.evaluate((files("axe_playwright_python") / "axe.min.js").read_text(encoding="utf-8") + "; 0")
    options: dict[str, Any] = {"resultTypes": ["violations"], "preload": False}
    if rules:
        options["runOnly"] = list(rules)
    found: dict[str, Any] = page.evaluate("options => axe.run(document, options)", options)
    return [
        f"{rule['id']}: {rule['help']}: {node['html'][:200]}: {node.get('failureSummary', '')[:300]}"
        for rule in found["violations"]
        for node in rule["nodes"]
    ]
