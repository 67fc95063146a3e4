"""Sends a journey and a moving train to a node on flat-6km (5 minutes), and prints its advice."""

import time

from das.advice.reason import Reason
from das.advice.wording import words
from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import ADVICE, JOURNEY, POSITION, RESTRICTION

start_ns, speed_mps = time.time_ns(), 20.0
stops = [
    das_pb2.Journey.Stop(name="A", s_m=0.0, departure_ns=start_ns),
    das_pb2.Journey.Stop(name="B", s_m=6000.0, arrival_ns=start_ns + 300 * 10**9),
]
journey = das_pb2.Journey(time_ns=start_ns, route_id="flat-6km", vehicle_id="re460-ic", stops=stops)
with Bus("IC1", listen="tcp/127.0.0.1:7448", connect=["tcp/127.0.0.1:7447"], hear=[ADVICE]) as bus:
    bus.publish(JOURNEY, journey)
    bus.publish(RESTRICTION, das_pb2.Restrictions(time_ns=start_ns))  # There are none, and the node must know.
    while (s_m := speed_mps * (time.time_ns() - start_ns) * 1e-9) < 6000.0:
        place = das_pb2.Position(time_ns=time.time_ns(), s_m=s_m, speed_mps=speed_mps, uncertainty_m=5.0)
        bus.publish(POSITION, place)
        received = bus.receive(0.5)
        if received and received.message:
            print(f"{words(Reason.read(received.message.reason))}: {3.6 * received.message.advised_speed_mps:.0f} km/h")
