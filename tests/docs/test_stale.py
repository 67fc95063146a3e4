"""Figures of the pages are those that their commands give today: tests/README.md says what fails and what warns."""

from __future__ import annotations

import ast
import base64
import html
import io
import json
import re
import warnings
from contextlib import redirect_stdout
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from das.drawing.picture import Picture
from docs.studies import coach, coach_days, made_by, null_experiments, paper, relaxed_loss, what_if
from docs.studies.made_by import ROOT, SAME_PICTURE, StaleFigures, marks_of, not_on_page, pages, picture_difference
from docs.studies.notebooks import NOTEBOOKS
from docs.studies.output import DOCS, Output, write_table
from tests.support.making import das_precompute, das_sim, printed

MARKS = [mark for page in pages() for mark in marks_of(page)]
BY_HAND = ("flow.svg",)
"""Pictures that no command makes."""
BLOCK = re.compile(r"<!-- ([\w-]+): begin -->")
NOT_FIGURES = ("bus.md", "assess-from-outside.md")
"""Pages with blocks that are words, each compared with the code by a test of its own."""
TABLES = DOCS / "reference" / "study"
"""Pages that a command writes whole, with a mark in their first line."""
NOTEBOOK = NOTEBOOKS["first-steps"]
SENSITIVITY = ("sensitivity", "zurich-luzern", "re460-ic", "--from", "Zug", "--to", "Luzern", "--buffer", "7")
QUICK = {
    "das-precompute loss-map re460-ic --plot docs/images/loss_map_gto.png": "test_maps_of_losses",
    "das-precompute loss-map re460-ic-igbt --plot docs/images/loss_map_igbt.png": "test_maps_of_losses",
    f"das-precompute {' '.join(SENSITIVITY)} --plot docs/images/sensitivity.png": "test_sensitivity",
    "das-precompute journey stops zurich-luzern re460-ic --buffer 7": "test_a_journey",
    "python -m docs.studies.coach price": "test_what_calm_costs",
    "python -m docs.studies.coach_days": "test_a_day_of_the_coach_and_the_what_if",
    "python -m docs.studies.calibrate --check --page": "test_calibrate.py",
    "python -m docs.studies.driver_days": "test_driver_days.py",
    "python -m docs.studies.driver_tables": "test_driver_days.py",
    "python -m docs.studies.estimation": "test_calibration.py",
    "python -m docs.studies.notebooks first-steps": "test_outputs_of_the_notebook",
    "python -m docs.studies.notebooks notebook-own-experiment": "test_notebook.py",
    "python -m docs.studies.notebooks notebook-own-line": "test_outputs_of_the_notebook_with_an_own_line",
    "python -m docs.studies.notebooks notebook-real-trip": "test_notebook.py",
    "python -m docs.studies.null_experiments": "test_null_experiments",
    "python -m docs.studies.paper --out study": "test_a_picture_of_the_study",
    "python -m docs.studies.relaxed_loss": "test_what_the_relaxation_allows",
    "python -m docs.studies.what_if": "test_a_day_of_the_coach_and_the_what_if",
    "python -m tests.reference.test_ttobench_matrix": "test_ttobench_matrix.py",
    "python -m tests.support.driver_tables": "test_population.py",
}
"""The test that makes each command's figures, or a part of them, again; a file where it stands elsewhere."""


def text_of(page: str) -> str:
    return (DOCS / page).read_text(encoding="utf-8").replace("\xa0", " ").replace("−", "-")


def plain_text(report: str) -> str:
    """The words and figures of a report, a line for each piece between two tags, without pictures, date and hashes."""
    outside = r"<(style|script|svg)\b.*?</\1>|20\d\d-\d\d-\d\dT[\d:+]+|\b[0-9a-f]{64}\b"
    without = re.sub(outside, "", report, flags=re.DOTALL)
    pieces = (" ".join(html.unescape(piece).split()) for piece in re.split(r"<[^>]+>", without))
    return "\n".join(piece for piece in pieces if piece)


def made_cells(notebook: Any) -> list[tuple[str, bytes | None]]:
    """What the cells of a notebook put out when they are run here: text, and the picture if there is one."""
    names: dict[str, Any] = {}
    found = []
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        text = io.StringIO()
        body = ast.parse("".join(cell["source"])).body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        with redirect_stdout(text):
            exec(compile(ast.Module(body, []), "cell", "exec"), names)
            value = None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        picture = value._repr_png_() if isinstance(value, Picture) else None
        if value is not None and picture is None:
            text.write(repr(value))
        found.append((" ".join(text.getvalue().split()), picture))
    return found


def kept_cells(notebook: Any) -> list[tuple[str, bytes | None]]:
    """What the cells of a notebook put out when it was committed."""
    found = []
    for cell in notebook["cells"]:
        outputs = cell.get("outputs", [])
        shown = [one["data"] for one in outputs if "data" in one]
        texts = ["".join(one["text"]) for one in outputs if "text" in one and one["name"] == "stdout"]
        texts += ["".join(data["text/plain"]) for data in shown if "image/png" not in data]
        pictures = [base64.b64decode("".join(data["image/png"])) for data in shown if "image/png" in data]
        if cell["cell_type"] == "code":
            found.append((" ".join(" ".join(texts).split()), pictures[0] if pictures else None))
    return found


def stale_cells(kept: list[tuple[str, bytes | None]], made: list[tuple[str, bytes | None]]) -> list[str]:
    """What a notebook was committed with and no longer puts out: texts, and "picture" for a picture."""
    stale = []
    for (text, picture), (new_text, new_picture) in zip(kept, made, strict=True):
        stale += not_on_page(text, [new_text] if new_text else [])
        if (picture is None) != (new_picture is None):
            stale.append("picture")
        elif picture is not None and new_picture is not None:
            stale += ["picture"] if picture_difference(picture, new_picture) > SAME_PICTURE else []
    return stale


def same_picture(page: Path, made: Path) -> bool:
    return picture_difference(page.read_bytes(), made.read_bytes()) <= SAME_PICTURE


# ------------------------------------------------------------------------------------------------- every figure, marks


def test_every_picture_and_every_table_that_a_script_writes_names_its_command() -> None:
    bare = []
    for page in pages():
        text = page.read_text(encoding="utf-8")
        about = "\n".join(mark.what if page.parent != TABLES else text for mark in marks_of(page))
        pictures = re.findall(r"!\[[^\]]*\]\([^)]*?([\w./-]+\.(?:png|svg))\)", text)
        blocks = [] if page.name in NOT_FIGURES else [f"<!-- {name}: begin -->" for name in BLOCK.findall(text)]
        blocks += ["|"] if page.parent == TABLES else []
        bare += [(page.name, one) for one in [*pictures, *blocks] if one not in about and not one.endswith(BY_HAND)]
    assert bare == []
    reports = "\n".join(mark.what for mark in MARKS)
    assert [path.name for path in (DOCS / "reports").glob("*.html") if f"reports/{path.name}" not in reports] == []


def test_every_quick_command_is_checked_and_every_slow_one_says_what_it_depends_on() -> None:
    assert {mark.command for mark in MARKS if mark.code is None} == set(QUICK)
    for name in QUICK.values():
        assert name in globals() or list((ROOT / "tests").rglob(name)), name
    for mark in MARKS:
        if mark.code is not None:
            paths = made_by.code_paths(mark.command)
            assert [path for path in paths if not (ROOT / path).exists()] == []


@pytest.mark.slow
def test_slow_figures_whose_code_has_changed_are_told() -> None:
    """A warning: `-W error::docs.studies.made_by.StaleFigures` makes it a failure, as before a release."""
    changed = list(made_by.changed_since(MARKS))
    if changed:
        warnings.warn("made by older code, to be made again:\n" + "\n".join(changed), StaleFigures, stacklevel=1)


# --------------------------------------------------------------------------------------------- quick figures, made anew


@pytest.mark.slow
def test_outputs_of_the_notebook() -> None:
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    kept, made = kept_cells(notebook), made_cells(notebook)
    assert stale_cells(kept, made) == []
    as_it_was = [(re.sub(r"'energy_kwh': [\d.]+", "'energy_kwh': 460.8", text), picture) for text, picture in kept]
    assert stale_cells(as_it_was, made) == [made[-2][0]]
    other_picture = [*kept[:-1], (kept[-1][0], kept[1][1])]
    assert stale_cells(other_picture, made) == ["picture"]


@pytest.mark.slow
def test_outputs_of_the_notebook_with_an_own_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The two slower ones beside it are run in test_notebook.py."""
    monkeypatch.chdir(tmp_path)
    notebook = json.loads(NOTEBOOKS["notebook-own-line"].read_text(encoding="utf-8"))
    assert stale_cells(kept_cells(notebook), made_cells(notebook)) == []


@pytest.mark.slow
def test_what_calm_costs() -> None:
    made = list(coach.price_table())
    assert not_on_page(text_of("explanation/coach.md"), made) == []
    assert len(not_on_page(text_of("explanation/coach.md").replace("213.62", "213.58"), made)) == 1


@pytest.mark.slow
def test_a_day_of_the_coach_and_the_what_if(tmp_path: Path) -> None:
    """One of the two days: its picture, and the two drives of the what-if that are the same."""
    day = "restriction-ahead"
    energies = (*coach_days.draw_day(tmp_path / "day.png", day), 0.0)
    assert same_picture(coach_days.FOLDER / f"{day}.png", tmp_path / "day.png")
    lines = list(what_if.what_if_table(energies))[:-1]
    assert not_on_page(text_of("how-to/ask-what-if.md"), lines) == []
    kept = "".join(text for text, _ in kept_cells(json.loads(NOTEBOOK.read_text(encoding="utf-8"))))
    clear_kwh = float(re.findall(r"'energy_kwh': ([\d.]+)", kept)[0])
    lines = list(what_if.what_if_table((*energies[:2], clear_kwh)))
    assert not_on_page(text_of("how-to/ask-what-if.md"), lines) == []


def test_null_experiments() -> None:
    lines = islice(null_experiments.null_table(), 3)
    assert not_on_page(text_of("explanation/experiment-statistics.md"), lines) == []


@pytest.mark.parametrize(("train", "name"), [("re460-ic", "gto"), ("re460-ic-igbt", "igbt")])
def test_maps_of_losses(train: str, name: str, tmp_path: Path) -> None:
    assert das_precompute(tmp_path, "loss-map", train, "--plot", "map.png").returncode == 0
    same = [
        other for other in ("gto", "igbt") if same_picture(DOCS / f"images/loss_map_{other}.png", tmp_path / "map.png")
    ]
    assert same == [name]


@pytest.mark.slow
def test_sensitivity(tmp_path: Path) -> None:
    """The table of the page has five of the printed columns, and a remark."""
    found = printed(tmp_path, *SENSITIVITY, "--plot", "picture.png")
    cells = [re.split(r"\s{2,}", line.strip()) for line in found.splitlines()]
    rows = [row for row in cells if len(row) == 9 and row[0][-1].isalnum() | row[0].endswith("%")]
    made = [f"| {r[0]} | {r[1]} | {r[2]} | {float(r[4]):+.2f} | {r[7]} | {r[8]} " for r in rows if r[0] != "changed"]
    page = re.sub(r"\|[^|]*\|$", "", text_of("explanation/sensitivity.md"), flags=re.MULTILINE)
    assert len(made) == 14
    assert not_on_page(page, made) == []
    assert not_on_page(page.replace("+13.52", "+13.25"), made) == [made[1]]
    assert same_picture(DOCS / "images" / "sensitivity.png", tmp_path / "picture.png")


def test_a_journey(tmp_path: Path) -> None:
    made = printed(tmp_path, "journey", "stops", "zurich-luzern", "re460-ic", "--buffer", "7").splitlines()
    page = text_of("explanation/journeys.md")
    assert not_on_page(page, [line.rstrip() for line in made if line.strip()]) == []
    assert len(not_on_page(page.replace("446.23 kWh", "446.32 kWh"), made)) == 1


def test_what_the_relaxation_allows(tmp_path: Path) -> None:
    relaxed_loss.main(tmp_path / "picture.png")
    assert same_picture(relaxed_loss.PICTURE, tmp_path / "picture.png")
    x = np.array([0.0, 1.0, 2.0, 3.0])
    assert relaxed_loss.lower_hull(x, np.array([0.0, 5.0, 1.0, 3.0])) == pytest.approx([0.0, 0.5, 1.0, 3.0])


@pytest.mark.slow
def test_a_picture_of_the_study(tmp_path: Path) -> None:
    paper.make(["fig4"], Output(tmp_path))
    assert same_picture(DOCS / "images" / "study" / "fig4.png", tmp_path / "fig4.png")


@pytest.mark.nightly
def test_every_picture_and_page_of_the_study(tmp_path: Path) -> None:
    paper.make(list(paper.ITEMS), Output(tmp_path))
    pictures = [
        path for path in (DOCS / "images" / "study").glob("*.png") if not same_picture(path, tmp_path / path.name)
    ]
    assert pictures == []
    for page in TABLES.glob("*.md"):
        made = (tmp_path / page.name).read_text(encoding="utf-8")
        assert not_on_page(page.read_text(encoding="utf-8"), made.splitlines()) == []


@pytest.mark.nightly
def test_the_report_of_the_smallest_study(tmp_path: Path) -> None:
    assert das_sim("experiment", "run", "smoke", "--out", "smoke", cwd=tmp_path).returncode == 0
    assert das_sim("experiment", "analyse", "smoke", "-o", "smoke.html", cwd=tmp_path).returncode == 0
    kept, made = (path.read_text(encoding="utf-8") for path in (DOCS / "reports/smoke.html", tmp_path / "smoke.html"))
    assert not_on_page(plain_text(kept), plain_text(made).splitlines()) == []


# --------------------------------------------------------------------------- stale figures of each kind that are caught


def small_picture(levels: tuple[int, ...]) -> bytes:
    """A picture of bars in these greys."""
    from PIL import Image

    picture, file = Image.new("L", (32 * len(levels), 64), 255), io.BytesIO()
    for number, level in enumerate(levels):
        picture.paste(level, (32 * number, 0, 32 * number + 32, 64))
    picture.save(file, format="png")
    return file.getvalue()


@pytest.mark.parametrize(
    ("page", "made", "stale"),
    [
        ("| clear-day | 18.9 | 532.6 |", "| clear-day | 18.9 | 532.6 |", False),
        ("| clear-day | 18.9 | 532.6 |", "| clear-day | 18.9 | 532.7 |", False),
        ("| clear-day | 18.9 | 532.6 |", "| clear-day | 18.9 | 532.8 |", True),
        ("| clear-day | 18.9 | 532.6 |", "| clear-day | 18.9 | 532 |", True),
        ("| clear-day | 18.9 | 532.6 |", "| train-ahead | 18.9 | 532.6 |", True),
        ("energy, kWh   +12.20  -0.05", "energy, kWh  +12.20   +0.05", True),
        ("saved 3 % of 571.3 kWh", "saved 3 % of 588.5 kWh", True),
    ],
)
def test_a_stale_line_of_a_table_or_of_a_command_is_caught(page: str, made: str, stale: bool) -> None:
    assert not_on_page(f"before\n{page}\nafter", [made]) == ([made] if stale else [])


def test_a_stale_table_of_a_page_is_caught() -> None:
    """A table as a command makes it, and the same with one figure as it was before."""
    lines = list(what_if.what_if_table((572.3, 595.5, 511.5)))
    page = "\n".join(lines)
    assert not_on_page(page, lines) == []
    assert not_on_page(page.replace("595.5", "594.0"), lines) == [lines[3]]


def test_stale_outputs_of_a_notebook_are_caught() -> None:
    def notebook(energy: str, picture: tuple[int, ...]) -> Any:
        data = {"image/png": base64.b64encode(small_picture(picture)).decode(), "text/plain": "<Figure>"}
        outputs = [{"data": {"text/plain": [f"{{'energy_kwh': {energy}}}"]}}, {"data": data}]
        return {"cells": [{"cell_type": "code", "source": [], "outputs": outputs}]}

    made = kept_cells(notebook("510.1", (0, 200)))
    assert stale_cells(kept_cells(notebook("510.1", (0, 200))), made) == []
    assert stale_cells(kept_cells(notebook("460.8", (0, 200))), made) == ["{'energy_kwh': 510.1}"]
    assert stale_cells(kept_cells(notebook("510.1", (0, 120))), made) == ["picture"]


def test_a_stale_picture_is_caught() -> None:
    """A bar in another grey, another size, and the picture of the other converters."""
    same = small_picture((0, 120, 200))
    assert picture_difference(same, same) == 0.0
    assert picture_difference(same, small_picture((0, 120, 160))) == pytest.approx(1 / 3)
    assert picture_difference(same, small_picture((0, 120))) == 1.0
    gto, igbt = ((DOCS / "images" / f"loss_map_{name}.png").read_bytes() for name in ("gto", "igbt"))
    assert picture_difference(gto, igbt) > SAME_PICTURE


def test_a_stale_report_is_caught() -> None:
    today = (DOCS / "reports" / "smoke.html").read_text(encoding="utf-8")
    figure = re.findall(r"<td[^>]*>\s*([\d.]+)\s*</td>", today)[0]
    older = today.replace(f">{figure}<", f">{float(figure) + 9.9:.2f}<")
    assert not_on_page(plain_text(today), plain_text(today).splitlines()) == []
    assert older != today
    assert not_on_page(plain_text(older), plain_text(today).splitlines()) != []


@pytest.fixture
def studied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A page with a slow table, made by a command that depends on one module."""
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "law.py").write_text("A = 1\n", encoding="utf-8")
    monkeypatch.setitem(made_by.DEPENDS_ON, "das-sim slow", ("code",))
    code = made_by.code_hash(("code",), tmp_path)
    page = tmp_path / "page.md"
    page.write_text(f"<!-- made by: das-sim slow x; code: {code}; on: 2026-01-02 -->\n| 1 |\n\nend\n", encoding="utf-8")
    return page


@pytest.mark.parametrize(
    ("source", "changed"),
    [
        ("A = 1\n", False),
        ('"""What it is."""\n\nA = 1  # of course\n', False),
        ("A = 2\n", True),
        ("A = 1\nB = 3\n", True),
    ],
)
def test_a_slow_figure_whose_code_has_changed_is_told(studied: Path, source: str, changed: bool) -> None:
    folder = studied.parent
    made_by._content.cache_clear()
    (folder / "code" / "law.py").write_text(source, encoding="utf-8")
    marks = marks_of(studied)
    assert [(mark.command, mark.what) for mark in marks] == [("das-sim slow x", "| 1 |")]
    told = "page.md: das-sim slow x: its code has changed since 2026-01-02"
    assert list(made_by.changed_since(marks, folder)) == ([told] if changed else [])


def test_all_stale_figures_are_made_again_and_stamped(
    studied: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of three commands one is fresh and one fails: that one keeps its old stamp, and is named."""
    folder = studied.parent
    monkeypatch.setattr(made_by, "MINUTES", {"das-sim slow a b": 3, "das-sim slow x": 2, "das-sim slow fails": 1})
    monkeypatch.setattr(made_by, "pages", lambda: [studied])
    monkeypatch.setattr(made_by, "code_hash", lambda paths, root=folder: "0000beef")
    text = "".join(
        f"<!-- made by: das-sim slow {name}; code: {code}; on: 2026-01-02 -->\n| 1 |\n\n"
        for name, code in (("x", "12345678"), ("fails", "12345678"), ("a b", "0000beef"))
    )
    studied.write_text(f"{text}<!-- made by: das-sim quick -->\n| 2 |\n", encoding="utf-8")
    commands = made_by.to_make(marks_of(studied))
    assert commands == ["das-sim slow x", "das-sim slow fails"]
    assert made_by.make_all(commands, lambda words: int(words[-1] == "fails")) == ["das-sim slow fails"]
    assert capsys.readouterr().out.splitlines()[0] == "1 of 2: das-sim slow x, about 2 of 3 min left"
    assert [(mark.code, mark.on) for mark in marks_of(studied)] == [
        ("0000beef", made_by.today()), ("12345678", "2026-01-02"), ("0000beef", "2026-01-02"), (None, None),
    ]  # fmt: skip


def test_every_slow_figure_can_be_made_by_one_command() -> None:
    slow = {mark.command for mark in MARKS if mark.code is not None and not mark.command.startswith("rerun")}
    assert sorted(slow - set(made_by.MINUTES)) == []
    assert sorted(set(made_by.MINUTES) - {mark.command for mark in MARKS}) == []


def test_a_mark_that_cannot_be_read_or_whose_command_nobody_knows_is_refused(studied: Path) -> None:
    studied.write_text("<!-- made by: das-sim slow; code: 12; on: today -->\n", encoding="utf-8")
    with pytest.raises(DasError, match="1 of its marks"):
        marks_of(studied)
    with pytest.raises(DasError, match="does not say what code"):
        made_by.code_paths("das-sim slowly")


def test_writing_a_table_stamps_its_mark_and_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(made_by.DEPENDS_ON, "python -m docs.studies.habits", ("das/domain/units.py",))
    page = tmp_path / "page.md"
    mark = "<!-- made by: python -m docs.studies.habits; code: 00000000; on: 2026-01-02 -->\n"
    page.write_text(f"{mark}| other |\n\n{mark}<!-- one: begin -->\nold\n<!-- one: end -->\n", encoding="utf-8")
    write_table(page, "one", ["| 1 |"])
    first, second = marks_of(page)
    assert (first.code, first.on) == ("00000000", "2026-01-02")
    paths = made_by.code_paths("python -m docs.studies.habits")
    assert (second.code, second.on) == (made_by.code_hash(paths), made_by.today())
    assert (
        made_by.stamped(page.read_text(encoding="utf-8"), second.command, "12345678", "2026-03-04").count("12345678")
        == 2
    )
