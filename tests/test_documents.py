"""What the documents name is there: tests, files of the packages, and the pages of the site."""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections.abc import Callable, Iterable
from pathlib import Path

import yaml

from docs.studies.reference import rows_of

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "tests").glob("*.md"),
        ROOT / "recordings" / "README.md",
    ]
)
NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))
PATH = re.compile(r"`((?:das|sim|precompute|tests|docs|recordings)/[\w./-]+)`")
LINK = re.compile(r"\]\(([^)\s]+)\)")
EXTRA = re.compile(r"'\.\[([a-z,]+)\]'")
OPTION = re.compile(r"(?<![\w-])--(?:csv|output)\b")


BUDGETS = {"how-to": 900, "tutorials": 900, "explanation": 1500, "reference": 2500}
"""Words that a page may have, by its folder in docs; what scripts write into a page between marks does not count."""
WORDS_IN_ALL = 45_075
"""Words of all pages together, as `wc -w` counts them."""
GROUPS = {"Plan", "Review", "Experiment", "People", "Operate"}
MOST_IN_A_GROUP = 6


def words(page: Path) -> int:
    """Words with a letter or digit, outside of what a script writes."""
    written = r"<!-- ([\w-]+): begin -->.*?<!-- \1: end -->"
    return len(re.findall(r"\S*\w\S*", re.sub(written, "", page.read_text(encoding="utf-8"), flags=re.DOTALL)))


def test_every_page_keeps_its_budget_of_words() -> None:
    over = {
        page.relative_to(ROOT).as_posix(): words(page)
        for folder, most in BUDGETS.items()
        for page in (ROOT / "docs" / folder).rglob("*.md")
        if words(page) > most
    }
    assert over == {}


def test_all_pages_together_keep_their_budget_of_words() -> None:
    pages = [*PAGES, ROOT / "tests" / "data" / "README.md"]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= WORDS_IN_ALL


def test_how_to_pages_are_grouped_by_role() -> None:
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    (groups,) = (one["How-to"] for one in nav if "How-to" in one)
    sizes = {name: len(pages) for group in groups for name, pages in group.items()}
    assert set(sizes) == GROUPS
    assert max(sizes.values()) <= MOST_IN_A_GROUP


def test_every_test_that_the_failures_name_is_there_once() -> None:
    page = (ROOT / "docs" / "reference" / "failures.md").read_text(encoding="utf-8")
    _, *rows = rows_of("failures")
    assert [said for said, _ in rows if f"| {said} |" not in page] == []
    named = [name.strip() for row in rows for name in row[-1].split(",")]
    there = [path.stem for path in (ROOT / "tests").rglob("test_*.py")]
    assert len(named) > len(rows) > 30
    assert {name: there.count(name) for name in named if there.count(name) != 1} == {}


def test_every_safety_rule_names_its_tests_and_they_are_there() -> None:
    _, *rows = rows_of("safety-rules")
    files = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")}
    missing = []
    for row in rows:
        named = re.findall(r"`(test_\w+)::(test_\w+)`", row[-1])
        assert named, row
        missing += [one for one in named if f"def {one[1]}(" not in files.get(one[0], "")]
    assert len(rows) > 15
    assert missing == []


def of_all(pages: Iterable[Path], wrong: Callable[[Path], list[str]]) -> dict[str, list[str]]:
    """What is wrong on each page where something is."""
    found = {page.relative_to(ROOT).as_posix(): wrong(page) for page in pages}
    assert found
    return {name: some for name, some in found.items() if some}


def test_every_file_of_ours_that_a_page_names_is_there() -> None:
    def missing(page: Path) -> list[str]:
        named = {name.rstrip("/") for name in PATH.findall(page.read_text(encoding="utf-8"))}
        return sorted(name for name in named if not (ROOT / name).exists())

    assert of_all(PAGES, missing) == {}


def anchors(page: Path) -> set[str]:
    """The anchors of a page as mkdocs and GitHub make them of its headings; of what mkdocstrings adds nothing."""
    words = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ +(.*)$", words, re.MULTILINE)
    texts = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", one) for one in headings]
    ascii_only = [unicodedata.normalize("NFKD", one).encode("ascii", "ignore").decode() for one in texts]
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", one).strip().lower()) for one in ascii_only}


def dead_links(page: Path) -> list[str]:
    """The links of a page to a file that is not there, or to no heading of it."""
    dead = []
    for link in LINK.findall(page.read_text(encoding="utf-8")):
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if link.startswith(("http://", "https://", "mailto:", "#das.", "#sim.")):
            continue
        if not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            dead.append(link)
    return dead


def test_every_link_leads_to_a_file_and_to_a_heading_in_it() -> None:
    """Also those of README and its neighbours, which are no pages of mkdocs."""
    assert of_all(PAGES, dead_links) == {}


def test_a_notebook_links_to_no_page() -> None:
    """It would be dead on the site: mkdocs-jupyter leaves `own-line.md` as it is, and mkdocs does not check it."""
    assert of_all(NOTEBOOKS, lambda notebook: LINK.findall(notebook.read_text(encoding="utf-8"))) == {}


def test_a_link_to_a_heading_or_a_file_that_is_gone_is_found(tmp_path: Path) -> None:
    (tmp_path / "b.md").write_text("# One `word`, and two\n", encoding="utf-8")
    page = tmp_path / "a.md"
    page.write_text("[a](b.md#one-word-and-two) [b](b.md#gone) [c](c.md) [d](#here)\n\n## Here\n", encoding="utf-8")
    assert dead_links(page) == ["b.md#gone", "c.md"]


def test_what_belongs_to_an_item_of_a_numbered_list_is_indented_by_four() -> None:
    """By less, Python-Markdown ends the list, and counts the next items from 1 again."""

    def too_little(page: Path) -> list[str]:
        text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        blocks = re.findall(r"^\d+\. .*?(?=^\S|\Z)", text, re.DOTALL | re.MULTILINE)
        return [line for block in blocks for line in re.findall(r"^ {1,3}[-*] .*", block, re.MULTILINE)]

    assert of_all(PAGES, too_little) == {}


def hidden_cells(text: str) -> list[str]:
    """The rows of tables that have not as many cells as their header: browsers leave out what is too much."""
    found, cells = [], None
    for line in re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE).splitlines():
        inside = line.startswith("|")
        number = len(re.split(r"(?<!\\)\|", line.strip().strip("|"))) if inside else None
        found += [line] if inside and cells not in (None, number) else []
        cells = (cells or number) if inside else None
    return found


def test_every_row_of_a_table_has_the_cells_of_its_header() -> None:
    assert of_all(PAGES, lambda page: hidden_cells(page.read_text(encoding="utf-8"))) == {}
    assert hidden_cells("| a | b |\n|---|---|\n| 1 | 2 | 3 |\n") == ["| 1 | 2 | 3 |"]


def test_every_extra_that_is_named_is_one_of_ours_and_is_installed_from_the_checkout() -> None:
    """The package is on no index: its name with an extra is known to nobody's pip."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        ours = set(tomllib.load(file)["project"]["optional-dependencies"])
    sources = [path for top in ("das", "precompute", "sim") for path in (ROOT / top).rglob("*.py")]
    texts = {path.name: path.read_text(encoding="utf-8") for path in [*PAGES, *NOTEBOOKS, *sources]}
    assert [name for name, text in texts.items() if "driver-advisory-system[" in text] == []
    named = {extra for text in texts.values() for found in EXTRA.findall(text) for extra in found.split(",")}
    install = (ROOT / "docs" / "how-to" / "install.md").read_text(encoding="utf-8")
    assert named <= ours
    assert [extra for extra in ours if f"`{extra}`" not in install] == []


def test_every_package_has_a_row_in_the_table_of_packages() -> None:
    page = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    packages = [path.parent for top in ("das", "precompute", "sim") for path in (ROOT / top).glob("*/__init__.py")]
    named = [path.relative_to(ROOT).as_posix() for path in packages]
    rows = "\n".join(line for line in page.splitlines() if line.startswith("| `"))
    assert [name for name in named if f"`{name}`" not in rows] == []


def test_no_page_names_an_option_that_is_gone() -> None:
    pages = [page for page in PAGES if page.name != "CHANGELOG.md"]
    assert [page.name for page in pages if OPTION.search(page.read_text(encoding="utf-8"))] == []
