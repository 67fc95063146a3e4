"""The on-board system without sockets and clocks: it decides whether there is advice, and which."""
