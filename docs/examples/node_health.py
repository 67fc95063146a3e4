"""Health check of das-node: exit code 0 if it reports a status within five seconds, else 1."""

import sys

from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import STATUS

train, node = sys.argv[1:3] if len(sys.argv) > 2 else ("IC1", "tcp/127.0.0.1:7447")
with Bus(train, connect=[node], hear=[STATUS]) as bus:
    received = bus.receive(5.0)
if received is None or received.message is None:
    sys.exit("no status from the node")
status = received.message
print(das_pb2.Status.State.Name(status.state), status.reason)
