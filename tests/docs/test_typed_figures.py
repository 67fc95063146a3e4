"""No measured result is typed into a page: it is built with the site, or cited from a dated result.

The rule: a sentence (or a row of a table) of README or of a page outside `docs/results` that states an energy in kWh, a
saving or a distance from the optimum in per cent or points, how late or early somebody came, how much of what a driver
was told was announced or kept, a mean or median in per cent, a figure with its interval (± beside it), a rate in place
of another one, or how fast or large a computation is, links to a dated result or a notebook, or has its figure from a
mark. What stands in code or in quotation marks, and what a script writes into a block, is not a sentence. Figures of
other kinds (settings, limits, definitions) are not looked at: of 17 sentences with a bare percentage or "s late" all
but one said what the program is set to.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.studies.figures import ROOT

PAGES = [
    ROOT / "README.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if ROOT / "docs" / "results" not in page.parents),
]
NUMBER = r"\d[\d.,]*(?: ?(?:to|–|-|and) ?\d[\d.,]*)?"
SHARE = rf"{NUMBER} ?(?:%|per cent|(?:percentage )?points)"
LATE = rf"{NUMBER} ?(?:s|seconds|min|minutes) (?:late|later|early|earlier|sooner)\b"
AVERAGE = r"(?:[Oo]n average|[Ii]n the (?:mean|median))"
MEASURED = re.compile(
    "|".join(
        (
            rf"{NUMBER} ?kWh\b",
            rf"\b(?:saves?|saved|savings?|costs?|gap)\b(?: \w+){{0,5}} {SHARE}",
            rf"\b(?:falls?|fell|drops?|dropped|reduces?|cuts?)\b(?: \w+){{0,2}} {SHARE}",
            rf"{SHARE} of (?:\w+ ){{0,3}}(?:(?:is|are|was|were) (?:announced|kept)|promises)\b",
            rf"{SHARE}(?: \w+){{0,2}} (?:less|more)(?: energy| with\b)",
            rf"{SHARE}(?: of [\w ]+?)?(?: above| below| from| off)(?: \w+){{0,2}} (?:optimum|best)\b",
            rf"\b(?:is|are|was|were|arrives?|arrived|comes?|came)(?: (?!more|less|up|at)\w+){{0,2}} {LATE}",
            rf"(?<!at least )(?<!at most )(?<![\d.]){SHARE}(?: \w+){{0,3}} {AVERAGE}|{AVERAGE}(?: \w+){{0,4}} {SHARE}",
            rf"{NUMBER} ± {NUMBER} ?(?:%|points|s\b)",
            rf"{SHARE} instead of",
            rf"{NUMBER} times (?:real time|faster|slower|as fast)",
            rf"\b(?:made|found|solved|answered|ready) (?:in|within) {NUMBER} ?(?:ms|s)\b",
            rf"{NUMBER} ?(?:s|ms|seconds) (?:of (?:processor|CPU) time|a (?:tick|section)\b)",
            rf"\b(?:takes?|took|needs?|needed)(?: \w+){{0,2}} {NUMBER} ?(?:ms|CPU s|MB|GB)\b",
        )
    )
)
CITED = re.compile(r"\]\((?:[\w./-]*results/0\.\d+/|[\w./-]*\.ipynb\))|\{\{ ")
SENTENCE = re.compile(r"(?<=[.:;!?])\s+(?=[^a-z])|\n\s*\n|\n(?=\s*(?:[-*|]|\d+\.) ?)")


def typed_figures(text: str) -> list[str]:
    """The sentences and rows of a page that state a measured result, and neither cite it nor have it from a mark."""
    without = re.sub(r"^\s*```.*?^\s*```|^(?: {4}|\t)(?![-*\d]).*$", "", text, flags=re.DOTALL | re.MULTILINE)
    without = re.sub(r"<!-- ([\w -]+): begin -->.*?<!-- \1: end -->", "", without, flags=re.DOTALL)
    without = re.sub(r"`[^`\n]*`|\"[^\"\n]*\"", "code", without)
    sentences = (" ".join(one.split()) for one in SENTENCE.split(without))
    return [one for one in sentences if MEASURED.search(one) and not CITED.search(one)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_no_page_has_a_typed_figure(page: Path) -> None:
    assert typed_figures(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "text",
    [
        "The train takes 237 kWh.",
        "It is fine: from Zug to Luzern 207.58 kWh are enough.",
        "| with the guide | 575.5 kWh | +3.1 |",
        "The guide saves 5.4 % of the energy.",
        "With it the energy falls by 3.1 %.",
        "99.7 % of all changes are announced.",
        "Advice is made in 0.9 ms.",
        "The solver is 30 times faster.",
        "Most of it is saved: this buffer saves 20–30 %.",
        "The quick bound leaves a gap of 0.1 to 1.3 % here.",
        "A driver with the guide needs 8 % less energy than one without.",
        "It is 1.4 % above the best run.",
        "A human who follows is driven at 1600 times real time.",
        "200 sections take 89 s of processor time.",
        "A check takes about 0.1 ms a tick.",
        "A section needs 0.3 to 0.5 GB.",
        "With the guide the driver arrives 12 s later.",
        "It came about 3 to 5 seconds early.",
        "The errors are 4.2 % in the mean.",
        "On average the persons take 2.6 % more.",
        "| guide | +3.1 ± 0.6 % |",
        "It errs little (6 % instead of 5).",
    ],
)
def test_a_typed_figure_is_found(text: str) -> None:
    page = f"# Page\n\nA plain sentence with 7 % buffer. {text} Another one."
    assert len(typed_figures(page)) == 1
    assert typed_figures(f"# Page\n\n{text.rstrip('. |')} ([results](../results/0.2/driver_days.md)).") == []


@pytest.mark.parametrize(
    "text",
    [
        "A brake of less than 60 % of the electric brake becomes coasting.",
        "The mass is known to 2 % and the resistance to 8 %.",
        "Stretches below {{ value: sim.review.scene.LEAST_KWH }} kWh are left out.",
        "With 10 % more time the run is slower.",
        "```text\nenergy 237 kWh\n```",
        "    das-sim says 237 kWh",
        "It prints `237 kWh` at its end.",
        'The display says "100 km/h, arrives 40 s late".',
        "If it is more than 1 s late, it is made again.",
        "Values are drawn within ±5 % of the file's.",
    ],
)
def test_a_setting_and_what_is_printed_are_no_typed_figures(text: str) -> None:
    assert typed_figures(f"# Page\n\n{text}\n") == []
