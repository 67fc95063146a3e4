"""The brain of the on-board system: everything except sockets and clocks."""
