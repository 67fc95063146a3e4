"""Driver advisory system: what rides in the cab."""

__version__ = "0.1.0"
