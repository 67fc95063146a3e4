"""The scripts behind the figures of the documentation: `uv run python -m docs.studies.NAME`, in a clone."""
