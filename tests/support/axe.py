"""axe, which looks for what keeps readers with a disability out of a page."""

from importlib.resources import files
from typing import Any

from playwright.sync_api import Page


def violations(page: Page) -> list[str]:
    """Each rule that the page breaks, and an element that does; asked from outside, as the policy admits no script."""
    page.evaluate((files("axe_playwright_python") / "axe.min.js").read_text(encoding="utf-8") + "; 0")
    found: dict[str, Any] = page.evaluate("axe.run(document, { resultTypes: ['violations'], preload: false })")
    return [
        f"{rule['id']}: {rule['help']}: {node['html'][:200]}: {node.get('failureSummary', '')[:300]}"
        for rule in found["violations"]
        for node in rule["nodes"]
    ]
