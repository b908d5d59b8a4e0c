"""Adds pages from outside docs/: CONTRIBUTING.md, CHANGELOG.md, the equations, and the examples as one page.

Links to them are written for the code host, `../CONTRIBUTING.md`; this hook changes them to these pages.
"""

import ast
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
PAGES = {"contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md", "task-space.md": "model/task_space.md"}
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
TARGETS = {f"../{name}": page for page, name in PAGES.items()}
TARGETS |= {f"../examples/{path.name}": f"examples.md#{path.stem}" for path in EXAMPLES}
TARGETS |= {"../examples": "examples.md"}


def examples_page() -> str:
    """All examples, each with the first paragraph of its docstring."""
    parts = [
        "# Examples\n\nThe files of the folder `examples/`. Each runs by itself, from a folder in which "
        "`gough-stewart build` was called.\n"
    ]
    for path in EXAMPLES:
        text = path.read_text(encoding="utf-8")
        first = (ast.get_docstring(ast.parse(text)) or "").split("\n\n")[0]
        parts.append(f"## {path.name} {{ #{path.stem} }}\n\n{first}\n\n```python\n{text.rstrip()}\n```\n")
    return "\n".join(parts)


def inside(markdown: str, root: str) -> str:
    """Change links from docs/ to files of the repository, or from its root into docs/, to links within the site."""
    made = re.sub(r"\]\((docs/)([^)]*)\)", r"](\2)", markdown) if root else markdown
    return re.sub(r"\]\(([^)#\s]+)\)", lambda found: f"]({TARGETS.get(found[1], found[1])})", made)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from outside docs/."""
    for page, name in PAGES.items():
        files.append(File.generated(config, page, content=inside((ROOT / name).read_text(encoding="utf-8"), "root")))
    files.append(File.generated(config, "examples.md", content=examples_page()))
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Files by their paths in the repository, not by the symbolic links of the package."""
    return re.sub(r"gough_stewart/(?=(model|fmu_build|harness)/)", "", content)


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Change links out of docs/ to the pages of the site."""
    return markdown if page.file.generated_by else inside(markdown, "")
