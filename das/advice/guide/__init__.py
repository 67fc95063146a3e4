"""The guide: from a reference to what a driver is told, second by second, without looking at a reference twice."""
