"""The arguments and options of `das-sim experiment analyse` and `das-sim experiment power`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

DEFAULT_PARTICIPANTS: Final = "12,24,36,48,76,100,150"

StudyArgument = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of a study that das-sim experiment run made.")
]
PageOption = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="FILE", help="Page to write (.html) [default: print in words].")
]
PdfOption = Annotated[
    Path | None, typer.Option("--pdf", metavar="FILE", help="The page as PDF, where Chromium is installed.")
]
EffectsOption = Annotated[
    list[float] | None,
    typer.Option(
        "--effect",
        metavar="X",
        help="Also say how many participants would show a difference of X, in the unit of the report (points for a "
        "ratio); may be given several times.",
        show_default=False,
    ),
]
PilotArgument = Annotated[
    Path | None,
    typer.Argument(
        metavar="DIR|DESIGN",
        help="Folder of a pilot study, whose drivers are drawn again; or a design (design file, frozen design.json or "
        "bundled study), for its level and number of comparisons (then --sd is needed).",
        show_default=False,
    ),
]
EffectOption = Annotated[
    float,
    typer.Option(
        "--effect", metavar="X", help="True difference to be found, in the unit of the report (points for a ratio)."
    ),
]
ComparisonOption = Annotated[
    str | None,
    typer.Option("--comparison", metavar="NAME", help="Planned comparison [default: the first].", show_default=False),
]
NumbersOption = Annotated[
    str, typer.Option("--participants", metavar="LIST", help="Numbers of participants, with commas between.")
]
WantedOption = Annotated[
    float, typer.Option("--power", metavar="X", help="Share of studies that are to find the difference.")
]
SdOption = Annotated[
    float | None,
    typer.Option(
        "--sd",
        metavar="X",
        help="Standard deviation between participants (bell curve) of their difference, or with --groups of their "
        "means; instead of a pilot's drivers.",
        show_default=False,
    ),
]
SdOfPairsOption = Annotated[
    float,
    typer.Option("--sd-pairs", metavar="X", help="With --sd: standard deviation between pairs of one participant."),
]
PairsOption = Annotated[
    int | None,
    typer.Option(
        "--pairs",
        metavar="N",
        min=1,
        help="Pairs of trials that each participant drives [default: as in the pilot, or 1].",
        show_default=False,
    ),
]
GroupsOption = Annotated[
    bool,
    typer.Option(
        "--groups",
        help="With --sd: each participant drives one of the two conditions, and numbers are those of each group.",
    ),
]
AlphaOption = Annotated[
    float | None,
    typer.Option(
        "--alpha", metavar="X", help="Level of the test [default: the design's, or 0.05].", show_default=False
    ),
]
