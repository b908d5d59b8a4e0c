"""Pages that exist once, outside of docs/: CONTRIBUTING.md, CHANGELOG.md, the equations, the examples as one page.

Links to them are written as the code host needs them, `../CONTRIBUTING.md`, and turned to these pages here.
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
    """Every example with the first paragraph of its docstring."""
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
    """The text with links from a page of docs/ to files of the repository, or from its root into docs/, made inner."""
    made = re.sub(r"\]\((docs/)([^)]*)\)", r"](\2)", markdown) if root else markdown
    return re.sub(r"\]\(([^)#\s]+)\)", lambda found: f"]({TARGETS.get(found[1], found[1])})", made)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from outside."""
    for page, name in PAGES.items():
        files.append(File.generated(config, page, content=inside((ROOT / name).read_text(encoding="utf-8"), "root")))
    files.append(File.generated(config, "examples.md", content=examples_page()))
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Files by their paths in the repository, not by the links that make the package."""
    return re.sub(r"gough_stewart/(?=(model|fmu_build|harness)/)", "", content)


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Turn links that lead out of docs/ to the pages made here."""
    return markdown if page.file.generated_by else inside(markdown, "")
