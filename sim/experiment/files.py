"""The names of the files of a study, and of two columns that several modules know."""

from __future__ import annotations

from typing import Final

DESIGN_TEXT: Final = "design.toml"
"""The frozen design as the user wrote it, with its comments."""
DESIGN_JSON: Final = "design.json"
"""The resolved design: every default written out, and the hash that freezes it."""
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
