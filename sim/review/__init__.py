"""Looking at recordings: what happened, as pictures and in the rerun viewer."""
