"""Figures of the pages: built with the site, dated in docs/results, or kept in README and the notebooks."""

from __future__ import annotations

import base64
import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config
from mkdocs.exceptions import Abort

from docs.studies import figures, paper
from docs.studies.figures import FIRST, ROOT, input_hash, longest_first, made, marks_of, value_of
from docs.studies.notebooks import NOTEBOOKS
from docs.studies.output import DOCS, Output
from tests.support.kept_figures import (
    kept_cells,
    made_cells,
    not_on_page,
    picture_difference,
    same_picture,
    stale_cells,
)  # fmt: skip

PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
RESULTS = DOCS / "results"
BY_HAND = "flow.svg"
"""The picture that no command makes."""
TITLE = re.compile(r"^# .*release 0\.\d+\.\d+.*, commit [0-9a-f]{8}, \d{1,2} \w+ 20\d\d$", re.MULTILINE)
PAPER = RESULTS / "0.2" / "paper"
WRITES = 'python -c \'print(6 * 7); open("a.png", "w").write("p"); open("b.md", "w").write("| 1 |\\n")\''
FAILS = "python -c 'raise SystemExit(\"no such line\")'"


# ------------------------------------------------------------------------------------------- built, dated, or in README


def test_every_mark_can_be_read_and_none_is_left_in_what_is_read_without_a_build() -> None:
    asked = [one for page in PAGES for one in marks_of(page.read_text(encoding="utf-8"), page.name)]
    commands = {command for command, _ in asked}
    assert len(commands) > 10
    assert longest_first(commands)[: len(FIRST)] == list(FIRST)
    for page in [ROOT / "README.md", *NOTEBOOKS.values(), *RESULTS.rglob("*.md")]:
        assert "{{" not in page.read_text(encoding="utf-8"), page


def test_every_value_that_a_page_asks_for_is_there() -> None:
    asked = [one for page in PAGES for one in figures.VALUE.finditer(page.read_text(encoding="utf-8"))]
    assert [value_of(one["module"], one["name"], one["factor"]) for one in asked]


def test_every_picture_that_is_kept_is_of_a_release_or_of_readme() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    kept = [*DOCS.rglob("*.png"), *DOCS.rglob("*.svg"), *DOCS.rglob("*.html")]
    elsewhere = [path for path in kept if RESULTS not in path.parents and path.name != BY_HAND]
    assert [path.name for path in elsewhere if f"docs/images/{path.name}" not in readme] == []


def test_every_result_says_in_its_title_of_which_release_data_seed_commit_and_day_it_is() -> None:
    """Tables of the paper's study belong to its page."""
    pages = [page for page in RESULTS.rglob("*.md") if page.parent != PAPER]
    assert [page.name for page in pages if not TITLE.search(page.read_text(encoding="utf-8"))] == []


def test_readme_says_what_the_notebook_finds() -> None:
    """The energies of the fastest run and with a buffer of 10 %, as the first output of the notebook has them."""
    (front, _), *_ = kept_cells(json.loads(NOTEBOOKS["first-steps"].read_text(encoding="utf-8")))
    fastest, buffered = map(float, re.findall(r"([\d.]+) kWh", front))
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"(\d+) % less energy with 10 % more", readme) == [f"{100.0 * (1.0 - buffered / fastest):.0f}"]


@pytest.mark.nightly
def test_outputs_of_the_notebook() -> None:
    notebook = json.loads(NOTEBOOKS["first-steps"].read_text(encoding="utf-8"))
    kept, now = kept_cells(notebook), made_cells(notebook)
    assert stale_cells(kept, now) == []
    as_it_was = [(re.sub(r"'energy_kwh': [\d.]+", "'energy_kwh': 460.8", text), picture) for text, picture in kept]
    assert stale_cells(as_it_was, now) == [now[-2][0]]
    other_picture = [*kept[:-1], (kept[-1][0], kept[1][1])]
    assert stale_cells(other_picture, now) == ["picture"]


@pytest.mark.slow
def test_outputs_of_the_notebook_with_an_own_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The two slower ones beside it are run in test_notebook.py."""
    monkeypatch.chdir(tmp_path)
    notebook = json.loads(NOTEBOOKS["notebook-own-line"].read_text(encoding="utf-8"))
    assert stale_cells(kept_cells(notebook), made_cells(notebook)) == []


# ------------------------------------------------------------------------------------- probes of the study of the paper


def test_a_picture_of_the_study(tmp_path: Path) -> None:
    paper.make(["fig4"], Output(tmp_path))
    assert same_picture(PAPER / "fig4.png", tmp_path / "fig4.png")


# ------------------------------------------------------------------------------------------------ the hook of the build


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a small site that uses the hook, and keeps its figures beside it."""
    monkeypatch.setattr(figures, "KEPT", tmp_path / "kept")
    monkeypatch.setattr(figures, "input_hash", lambda: "inputs")
    (tmp_path / "docs" / "deep").mkdir(parents=True)
    config = "site_name: S\ntheme: mkdocs\nuse_directory_urls: false\nplugins: []\nhooks: [hook.py]\n"
    (tmp_path / "mkdocs.yml").write_text(config, encoding="utf-8")
    (tmp_path / "hook.py").write_text("from docs.studies.figures import on_files, on_page_markdown\n", encoding="utf-8")
    return tmp_path


def built(site: Path, text: str) -> str:
    """A page in a folder of the site, built."""
    (site / "docs" / "deep" / "page.md").write_text(text, encoding="utf-8")
    build(load_config(str(site / "mkdocs.yml"), strict=True))
    return (site / "site" / "deep" / "page.html").read_text(encoding="utf-8")


def test_a_page_gets_what_a_command_prints_and_writes(site: Path) -> None:
    text = f"It is {{{{ figures: {WRITES} }}}}.\n\n![P]({{{{ figures: {WRITES} -> a.png }}}})\n"
    text += (
        f"\nTable: {{{{ figures: {WRITES} -> b.md }}}}, {{{{ value: docs.studies.null_experiments.ALPHA * 100 }}}} %\n"
    )
    page = built(site, text)
    assert "It is 42." in page
    assert 'src="../figures/a.png"' in page
    assert "Table: | 1 |, 5 %" in page
    assert (site / "site" / "figures" / "a.png").read_text(encoding="utf-8") == "p"


def test_a_command_runs_once_and_again_when_its_inputs_change(tmp_path: Path) -> None:
    draws = "python -c 'import os; print(os.urandom(8))'"
    first = made([draws], "inputs", tmp_path)
    assert made([draws], "inputs", tmp_path) == first
    assert made([draws], "other inputs", tmp_path) != first
    assert [path for path in tmp_path.iterdir() if not path.is_dir() or path.name.startswith(figures.MAKING)] == []


def test_a_fork_leaves_alone_what_the_process_that_it_copies_has_open(tmp_path: Path) -> None:
    """A folder that is removed at the end of its process is there after a fork of that process has ended."""
    held = (
        "import tempfile; from pathlib import Path; from docs.studies.forks import forked; "
        "held = tempfile.TemporaryDirectory(); here = Path(held.name); "
        'one = forked(("-c", "print(6 * 7)"), here, here); one.join(); '
        'print(one.exitcode, (here / "printed.txt").read_text())'
    )
    command = f"python -c '{held}'"
    assert (made([command], "inputs", tmp_path)[command] / "printed.txt").read_text(encoding="utf-8") == "0 42\n\n"


def test_what_is_no_longer_asked_for_is_not_kept(site: Path) -> None:
    built(site, f"{{{{ figures: {WRITES} }}}}\n")
    (old,) = (site / "kept").iterdir()
    built(site, "{{ figures: python -c 'print(1)' }}\n")
    assert not old.exists()
    assert len(list((site / "kept").iterdir())) == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{{{{ figures: {FAILS} }}}}", "exit code 1: no such line"),
        ("{{ figures: rm -rf / }}", "expected a command that begins with das-sim, das-precompute, python"),
        (f"{{{{ figures: {WRITES} -> c.md }}}}", "it does not write c.md"),
        ("{{ figures }}", "page.md: a mark cannot be read"),
        ("{{ value: docs.studies.none.A }}", "docs.studies.none.A: no such module"),
        ("{{ value: docs.studies.figures.NONE }}", "the module assigns no such name"),
        ("{{ value: docs.studies.figures.ROOT }}", "expected a literal"),
    ],
)
def test_a_bad_mark_ends_the_build_with_its_cause(
    site: Path, text: str, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(Abort):
        built(site, f"{text}\n")
    assert said in caplog.text
    assert not list((site / "kept").glob("*")) or "c.md" in said


def test_two_commands_do_not_write_one_picture(site: Path, caplog: pytest.LogCaptureFixture) -> None:
    other = WRITES.replace("6 * 7", "1")
    text = "".join(f"![P]({{{{ figures: {command} -> a.png }}}})\n" for command in (WRITES, other))
    with pytest.raises(Abort):
        built(site, text)
    assert "a.png: two commands" in caplog.text


def test_inputs_are_the_sources_and_not_what_python_keeps_of_them(tmp_path: Path) -> None:
    def now() -> str:
        return input_hash(("code",), tmp_path)

    (tmp_path / "code" / "__pycache__").mkdir(parents=True)
    law = tmp_path / "code" / "law.py"
    law.write_text("A = 1\n", encoding="utf-8")
    before = now()
    (tmp_path / "code" / "__pycache__" / "law.pyc").write_text("kept", encoding="utf-8")
    assert now() == before
    (tmp_path / "code" / "train.toml").write_text("mass = 1\n", encoding="utf-8")
    with_train = now()
    law.write_text("A = 2\n", encoding="utf-8")
    assert len({before, with_train, now()}) == 3


def test_the_tests_whose_drives_a_script_takes_are_inputs() -> None:
    scripts = (path.read_text(encoding="utf-8") for path in (DOCS / "studies").glob("*.py"))
    taken = {one.replace(".", "/") for text in scripts for one in re.findall(r"from (tests[\w.]*) import", text)}
    assert len(taken) > 1
    assert [one for one in taken if not one.startswith(figures.SOURCES)] == []


# ------------------------------------------------------------------------------------------ stale figures that are kept


def small_picture(levels: tuple[int, ...]) -> bytes:
    """A picture of bars in these greys."""
    from PIL import Image

    picture, file = Image.new("L", (32 * len(levels), 64), 255), io.BytesIO()
    for number, level in enumerate(levels):
        picture.paste(level, (32 * number, 0, 32 * number + 32, 64))
    picture.save(file, format="png")
    return file.getvalue()


@pytest.mark.parametrize(
    ("page", "made_now", "stale"),
    [
        ("| clear-day | 18.9 | 532.6 |", "| clear-day | 18.9 | 532.6 |", False),
        ("| clear-day | 18.9 | 532.6 |", "| clear-day | 18.9 | 532.7 |", False),
        ("| clear-day | 18.9 | 532.6 |", "| clear-day | 18.9 | 532.8 |", True),
        ("| clear-day | 18.9 | 532.6 |", "| clear-day | 18.9 | 532 |", True),
        ("| clear-day | 18.9 | 532.6 |", "| train-ahead | 18.9 | 532.6 |", True),
        ("energy, kWh   +12.20  -0.05", "energy, kWh  +12.20   +0.05", True),
    ],
)
def test_a_stale_line_is_caught(page: str, made_now: str, stale: bool) -> None:
    assert not_on_page(f"before\n{page}\nafter", [made_now]) == ([made_now] if stale else [])


def test_stale_outputs_of_a_notebook_are_caught() -> None:
    def notebook(energy: str, picture: tuple[int, ...]) -> Any:
        data = {"image/png": base64.b64encode(small_picture(picture)).decode(), "text/plain": "<Figure>"}
        outputs = [{"data": {"text/plain": [f"{{'energy_kwh': {energy}}}"]}}, {"data": data}]
        return {"cells": [{"cell_type": "code", "source": [], "outputs": outputs}]}

    now = kept_cells(notebook("510.1", (0, 200)))
    assert stale_cells(kept_cells(notebook("510.1", (0, 200))), now) == []
    assert stale_cells(kept_cells(notebook("460.8", (0, 200))), now) == ["{'energy_kwh': 510.1}"]
    assert stale_cells(kept_cells(notebook("510.1", (0, 120))), now) == ["picture"]


def test_a_stale_picture_is_caught() -> None:
    """A bar in another grey, and another size."""
    same = small_picture((0, 120, 200))
    assert picture_difference(same, same) == 0.0
    assert picture_difference(same, small_picture((0, 120, 160))) == pytest.approx(1 / 3)
    assert picture_difference(same, small_picture((0, 120))) == 1.0
