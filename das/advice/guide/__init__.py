"""The guide: it plans a reference, keeps it as long as it can, and leads the driver along it by instructions."""
