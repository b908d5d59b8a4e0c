"""`python -m tools.pages`: blocks run in order, outputs are written into the page, and a failure leaves it alone."""

from pathlib import Path

import pytest

from tools.pages.__main__ import rewrite
from tools.pages.blocks import blocks_of
from tools.pages.outputs import comparable, excerpt, shown_below
from tools.pages.story import FailedCommandError

PAGE = """\
Save this:

```python title="count.py"
import sys
```

and add

```python title="count.py"
print("counted", len(sys.argv[1:]), "\\n" * 2 + "end  ")
```

```sh
pip install nothing
python count.py a#1 b  # a comment
```

```text
counted 7
```

```python
print(open("count.py").read().count("import"))
```

```text
```

```toml title="kept.toml"
a = 1
```
"""
WRITTEN = PAGE.replace("counted 7", "counted 2\n\nend").replace("\n```text\n```", "\n```text\n1\n```")


@pytest.fixture
def page(tmp_path: Path) -> Path:
    path = tmp_path / "page.md"
    path.write_text(PAGE)
    return path


def test_outputs_are_written_below_what_prints_them(page: Path, tmp_path: Path) -> None:
    """Expected: what the two print, without spaces at line ends, files joined; as it was if durations alone differ."""
    rewrite(str(page), tmp_path)
    assert page.read_text() == WRITTEN
    assert (tmp_path / "kept.toml").read_text() == "a = 1\n"
    shown = WRITTEN.replace("print(open", "print('in 0.1 s', open").replace("text\n1", "text\nin 7 s 1")
    page.write_text(shown)
    (tmp_path / "again").mkdir()
    rewrite(str(page), tmp_path / "again")
    assert page.read_text() == shown


def test_a_command_that_fails_is_named_with_its_place_and_leaves_the_page(page: Path, tmp_path: Path) -> None:
    broken = PAGE.replace("import sys", "import sys, nowhere")
    page.write_text(broken)
    with pytest.raises(FailedCommandError, match=r"python count.py a#1 b\n.*[\s\S]*nowhere") as failed:
        rewrite(str(page), tmp_path)
    assert failed.value.__notes__ == [f"{page}:13"]
    assert page.read_text() == broken


def test_an_output_belongs_to_the_block_right_above(page: Path) -> None:
    """Expected: none where a sentence stands between, or a block with a title."""
    blocks = "```sh\na\n```\n\nThat is:\n\n```text\nb\n```\n\n```sh\nc\n```\n\n```text\nd\n```\n"
    page.write_text(blocks)
    shown = shown_below(blocks_of(str(page)), page.read_text())
    assert [(block.text, output.text) for block, output in shown.items()] == [("c\n", "d\n")]


def test_an_excerpt_has_as_many_lines_at_both_ends_as_the_page_shows() -> None:
    assert excerpt("x\n…\ny\nz\n", "\n1\n2\n3\n4\n5  \n\n") == "1\n…\n4\n5\n"
    assert excerpt("x\n…\n", "1\n2\n3\n") == "1\n…\n"
    assert excerpt("", "1\n2\n") == "1\n2\n"


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("Done in 3.2 s. Wrote (75 kB):", "Done in 2 min 14 s. Wrote (8.1 MB):", True),
        ("1000 members in 3 s, 900 members/s", "1000 members in 2.5 s, 1200 members/s", True),
        ("1000 members in 3 s", "1001 members in 3 s", False),
        ("peak at 3.2 s", "peak at 3.3 s", False),
        ("0.348 mm", "0.349 mm", False),
    ],
)
def test_durations_and_sizes_do_not_count_and_all_else_does(one: str, other: str, same: bool) -> None:
    assert (comparable(one) == comparable(other)) is same
