"""What the documents name is there: tests, files of the packages, and the pages of the site."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "tests").glob("*.md")])
PATH = re.compile(r"`((?:das|sim|precompute|tests|docs|recordings)/[\w./-]+)`")
OPTION = re.compile(r"(?<![\w-])--(?:csv|output)\b")


def test_every_test_that_the_failures_name_is_there_once() -> None:
    page = (ROOT / "docs" / "reference" / "failures.md").read_text(encoding="utf-8")
    rows = [line.strip("|").split("|") for line in page.splitlines() if line.startswith("| ")][1:]
    named = [name.strip() for row in rows for name in row[-1].split(",")]
    there = [path.stem for path in (ROOT / "tests").rglob("test_*.py")]
    assert len(named) > len(rows) > 30
    assert {name: there.count(name) for name in named if there.count(name) != 1} == {}


def test_every_safety_rule_names_its_tests_and_they_are_there() -> None:
    page = (ROOT / "docs" / "reference" / "safety-rules.md").read_text(encoding="utf-8")
    rows = [line.strip("|").split("|") for line in page.splitlines() if line.startswith("| ")][1:]
    files = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")}
    missing = []
    for row in rows:
        named = re.findall(r"`(test_\w+)::(test_\w+)`", row[-1])
        assert named, row
        missing += [one for one in named if f"def {one[1]}(" not in files.get(one[0], "")]
    assert len(rows) > 15
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_file_of_ours_that_a_page_names_is_there(page: Path) -> None:
    named = {name.rstrip("/") for name in PATH.findall(page.read_text(encoding="utf-8"))}
    assert sorted(name for name in named if not (ROOT / name).exists()) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_to_a_file_leads_somewhere(page: Path) -> None:
    """mkdocs checks the links of its own pages; README and its neighbours are read elsewhere."""
    text = page.read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text)
    files = [link for link in links if not link.startswith(("http://", "https://", "mailto:"))]
    assert [link for link in files if not (page.parent / link).exists()] == []


def test_every_package_has_a_row_in_the_table_of_packages() -> None:
    page = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    packages = [path.parent for top in ("das", "precompute", "sim") for path in (ROOT / top).glob("*/__init__.py")]
    named = [path.relative_to(ROOT).as_posix() for path in packages]
    rows = "\n".join(line for line in page.splitlines() if line.startswith("| `"))
    assert [name for name in named if f"`{name}`" not in rows] == []


def test_no_page_names_an_option_that_is_gone() -> None:
    pages = [page for page in PAGES if page.name != "CHANGELOG.md"]
    assert [page.name for page in pages if OPTION.search(page.read_text(encoding="utf-8"))] == []
