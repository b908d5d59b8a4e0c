"""An HTML file that makes no requests: its policy forbids them, and admits no script but its own."""

import base64
import hashlib
import html
import json
from collections.abc import Sequence
from importlib.resources import files
from string import Template
from typing import Any


def document(title: str, body: str, style: str, data: Any, scripts: Sequence[str], computes: bool = False) -> bytes:
    """A complete page.

    Parameters
    ----------
    title
        Plain text.
    body
        HTML; all texts from users must be escaped.
    style
        CSS.
    data
        Data for the scripts, as JSON in the element `data`.
    scripts
        JavaScript, in the order of execution.
    computes
        Its policy admits WebAssembly, and workers from the page itself.
    """
    # browsers normalise line endings before they hash a script
    scripts = [script.replace("\r\n", "\n").replace("\r", "\n") for script in scripts]
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = {
        "default-src": "'none'",
        "script-src": " ".join(f"'sha256-{digest}'" for digest in digests),
        "style-src": "'unsafe-inline'",
        "img-src": "data: blob:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    if computes:
        allowed["script-src"] += " 'wasm-unsafe-eval'"
        allowed["worker-src"] = "blob:"
    page = Template(asset("page.html")).substitute(
        title=html.escape(title),
        policy="; ".join(f"{what} {source}" for what, source in allowed.items()),
        style=style,
        body=body,
        # so that no text in it can close the element
        data=json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c"),
        scripts="\n".join(f"<script>{script}</script>" for script in scripts),
    )
    # the name of a folder may not be UTF-8
    return page.encode(errors="replace")


def asset(name: str) -> str:
    """A file of the folder `web`."""
    return (files("gough_stewart.harness.report") / "web" / name).read_text(encoding="utf-8")
