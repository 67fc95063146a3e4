"""Tight bounds of energy for loss maps, proven by minutes of search; most bounds need only `das.offline.bound`."""
