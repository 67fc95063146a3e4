"""A driver as a process, for `das-sim run clear-day --driver external`; it knows nothing but the messages."""

import math
import sys

from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import CAB, CONTROL, CONTROLS

BRAKING_MPS2, BELOW_MPS = 0.5, 1.0
TRAIN_M, AT_STOP_M, BEFORE_SIGNAL_M = 300.0, 10.0, 15.0


def controls(cab: das_pb2.Cab) -> das_pb2.Controls:
    """Hold the highest speed from which all limits and the next halt can be kept."""
    halt_m = cab.stop_m
    if not math.isnan(cab.signal_m):
        halt_m = min(halt_m, cab.signal_m - BEFORE_SIGNAL_M)
    waits = not cab.may_depart or cab.clock_s < cab.departure_s
    if cab.speed_mps <= 0 and (waits or halt_m - cab.s_m < AT_STOP_M):
        return das_pb2.Controls(look=cab.look, force_n=0.0)
    limits = [(cab.s_m, cab.limit_mps)]
    limits += [(one.s_m, one.limit_mps) for one in cab.limits_ahead]
    for one in cab.restrictions:
        if cab.s_m < one.end_m + TRAIN_M:  # until the tail has left
            limits.append((one.start_m, one.limit_mps))
    soon_m = cab.s_m + cab.speed_mps  # a second ahead: brakes take about that long
    top_mps = min(
        math.sqrt(v_mps**2 + 2 * BRAKING_MPS2 * max(s_m - soon_m, 0.0))
        for s_m, v_mps in [(halt_m, 0.0), *((s, v - BELOW_MPS) for s, v in limits)]
    )
    held = das_pb2.Controls.HeldSpeed(speed_mps=top_mps)
    return das_pb2.Controls(look=cab.look, held_speed=held)


endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7450"
with Bus("train-1", connect=[endpoint], hear=[CAB, CONTROL]) as bus:
    over, begun = False, False
    while not over:
        received = bus.receive(0.2)
        if received is None and not begun:
            bus.publish(CONTROLS, das_pb2.Controls())  # the run waits for this
        elif received and received.topic is CAB and received.message.look:
            begun = True
            bus.publish(CONTROLS, controls(received.message))
        elif received and received.topic is CONTROL:
            over = received.message.command == das_pb2.Control.COMMAND_FINISH
