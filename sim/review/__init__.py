"""The review of recordings: as a report, as pictures and in the rerun viewer."""
