"""What the README quotes is what the measurements say."""

from pathlib import Path

import pytest

from tactile_diffusers.cli import update_readme as excerpts

ROOT = Path(__file__).parents[2]
RESULTS = """# All
<!-- begin speed -->

### Speed

Two cores.

#### Segment

| s |
|---|
| 1 |

#### Batch

none

<!-- end speed -->
"""


def test_an_excerpt_ends_at_the_next_title():
    assert excerpts.excerpt(RESULTS, "speed", "Speed") == "Two cores."
    assert excerpts.excerpt(RESULTS, "speed", "Segment") == "| s |\n|---|\n| 1 |"
    assert excerpts.excerpt(RESULTS, "speed", "Batch") == "none"


@pytest.mark.parametrize(("name", "title"), [("slow", "Speed"), ("speed", "Seg")])
def test_what_is_not_there(name, title):
    with pytest.raises(ValueError, match="no block 'slow'|no title 'Seg'"):
        excerpts.excerpt(RESULTS, name, title)


def test_the_command_copies_and_checks(tmp_path):
    readme, results = tmp_path / "README.md", tmp_path / "RESULTS.md"
    readme.write_text("a\n<!-- begin speed / Segment -->\n<!-- end speed / Segment -->\nb\n")
    results.write_text(RESULTS)
    words = ["--readme", str(readme), "--results", str(results)]
    assert excerpts.main([*words, "--check"]) == 1 and "| s |" not in readme.read_text()
    assert excerpts.main(words) == 0 and excerpts.main([*words, "--check"]) == 0
    assert readme.read_text().startswith("a\n<!-- begin speed / Segment -->\n\n| s |")
    assert readme.read_text().endswith("b\n")


def test_the_readme_is_up_to_date():
    assert excerpts.quoted((ROOT / "README.md").read_text(encoding="utf-8"))
    assert excerpts.main(["--check", "--readme", str(ROOT / "README.md"), "--results", str(ROOT / "RESULTS.md")]) == 0
