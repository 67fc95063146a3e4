"""The names of a study's files, of the columns of its table of trials and of the keys of its resolved design."""

from __future__ import annotations

from typing import Final

DESIGN_TEXT: Final = "design.toml"
"""The frozen design as the user wrote it, with its comments."""
DESIGN_JSON: Final = "design.json"
"""The resolved design: every default written out, and the hash that freezes it. Its keys begin with `KEY_`."""
TRIALS_TABLE: Final = "trials.csv"
"""The tidy table: one row for each finished trial, by participant and then by position (UTF-8, comma, decimal point).

A value that is missing is empty. No column depends on the wall clock: the same design gives the same bytes.
"""
TRIALS_SIDECAR: Final = "trials.json"
"""What every column of the table means: column → {LongName, Description, Units}, as in BIDS."""

FAILED_TABLE: Final = "failed.csv"
"""The trials that failed, each with the reason; it is there only where some did."""

PEOPLE_TABLE: Final = "participants.tsv"
"""The participants: number in the population, group, and the parameters that were drawn."""
PERSON_ID: Final = "participant_id"
"""Column of the participants: the name that the table of trials has for them."""
PERSON_NUMBER: Final = "person"
"""Column of the participants: number in the population."""

CHECKSUMS: Final = "checksums.json"
"""The SHA-256 of the tables that are analysed, by their names: file → hash."""
CHECKED_TABLES: Final = (TRIALS_TABLE, PEOPLE_TABLE)
"""The tables whose hashes are kept."""

PROVENANCE: Final = "provenance.json"
"""Which program made the data from which files, when and how."""

KEY_HASH: Final = "hash"
"""SHA-256 of the canonical design."""
KEY_NAME: Final = "name"
KEY_SEED: Final = "seed"
KEY_FACTORS: Final = "factors"
"""Name of each factor → {levels: [texts, as in the table of trials], within: true or false}."""
KEY_LEVELS: Final = "levels"
KEY_WITHIN: Final = "within"
KEY_MEASURES: Final = "measures"
"""Names of the measures, which are columns of the table of trials."""
KEY_COMPARISONS: Final = "comparisons"
"""Planned comparisons: {name, measure, factor, a, b, where}. The difference is a − b.

`where` fixes levels of other factors; it is {} where the comparison is over all of them.
"""
KEY_ALPHA: Final = "alpha"
KEY_CORRECTION: Final = "correction"
DEFAULT_ALPHA: Final = 0.05
CORRECTIONS: Final = ("holm", "bonferroni", "none")
"""How planned comparisons are corrected for their number; the first is the default."""
LEAST_PARTICIPANTS: Final = 6
"""With fewer participants (in a group) too few different resamples exist; Student's t is used alone."""

TRIAL: Final = "trial"
"""Column: number of the trial in the study, from 1."""
PARTICIPANT: Final = "participant"
"""Column: the participant, as `sub-01`."""
SESSION: Final = "session"
"""Column: the session, as `ses-01`; a break of the design begins another."""
POSITION: Final = "position"
"""Column: place of the trial in the order of its participant, from 1."""
PRACTICE: Final = "practice"
"""Column: 1 for a practice trial, which is not for analysis, and else 0."""
CONDITION: Final = "condition"
"""Column: the levels of all factors in the order of the design, joined by `_`."""
SEED: Final = "seed"
"""Column: the seed of the day; trials with the same seed meet the same day."""
BEFORE_FACTORS: Final = (TRIAL, PARTICIPANT, SESSION, POSITION, PRACTICE, CONDITION)
"""Columns before those of the factors. After the factors comes `SEED`, then one column for each measure."""


def columns(factors: list[str], measures: list[str]) -> list[str]:
    """The header of the table of trials."""
    return [*BEFORE_FACTORS, *factors, SEED, *measures]
