"""Tables for a network: a plan of routes × trains × loads × levels, built on this machine or on a cluster."""
