"""The same with Zenoh and the messages of das.proto alone: what a publisher of your own has to do."""

import json
import time

import zenoh

from das.bus import das_pb2

config = zenoh.Config()
for key, value in {
    "mode": "peer",
    "listen/endpoints": ["tcp/127.0.0.1:7448"],
    "connect/endpoints": ["tcp/127.0.0.1:7447"],
    "scouting/multicast/enabled": False,
    "timestamping/enabled": True,  # 1: every message bears the time and the name of this session.
}.items():
    config.insert_json5(key, json.dumps(value))

start_ns, speed_mps = time.time_ns(), 20.0
stops = [
    das_pb2.Journey.Stop(name="A", s_m=0.0, departure_ns=start_ns),
    das_pb2.Journey.Stop(name="B", s_m=6000.0, arrival_ns=start_ns + 300 * 10**9),
]
journey = das_pb2.Journey(time_ns=start_ns, route_id="flat-6km", vehicle_id="re460-ic", stops=stops)
restrictions = das_pb2.Restrictions(time_ns=start_ns)  # There are none, and the node must know.

with zenoh.open(config) as session:
    orders = []
    for topic, order in (("journey", journey), ("restriction", restrictions)):
        publisher = zenoh.ext.declare_advanced_publisher(
            session,
            f"das/IC1/{topic}",
            cache=zenoh.ext.CacheConfig(max_samples=1),  # 2: a node that comes later, or again, gets the order.
            publisher_detection=True,  # 3: a liveliness token, so that the node learns when this program is gone.
        )
        publisher.put(order.SerializeToString())
        orders.append(publisher)  # A publisher lives as long as it is kept.
    positions = session.declare_publisher("das/IC1/position")
    while (s_m := speed_mps * (time.time_ns() - start_ns) * 1e-9) < 6000.0:
        place = das_pb2.Position(
            time_ns=time.time_ns(),
            s_m=s_m,  # metres
            speed_mps=speed_mps,  # 4: m/s, not km/h
            uncertainty_m=5.0,
            speed_uncertainty_mps=0.2,
        )
        positions.put(place.SerializeToString())
        time.sleep(1.0)
