import das
from das.cab import heard, outputs
from das.cab.cab import Cab, CabSettings
from das.cab.orders import Post, Trains
from das.cab.preparation import Fronts
from das.cab.situation import Situation
from das.estimate.estimate import Effort, PositionFix

S, zero = 10**9, 1_800_000_000 * 10**9  # Times are whole nanoseconds since 1970.
route, train = das.load_route("flat-6km"), das.load_vehicle("re460-ic")
a, b = route.stops[0], route.stops[-1]
settings = CabSettings(calibrate=True, guide=True)
post = Post(train="IC1", route=route, trains=Trains(train, train))
cab = Cab(post, Situation(route=route, vehicle=train), Fronts(threads=1), settings)

ops = {"heard_ns": zero, "source": "ops", "time_ns": zero}
stops = (heard.OrderedStop(a.name, a.position_m, 0, zero), heard.OrderedStop(b.name, b.position_m, zero + 260 * S, 0))
states = (heard.Kind.JOURNEY, heard.Kind.RESTRICTION, heard.Kind.TARGET)
told = [heard.PublisherSeen(kind=kind, source="ops", there=True) for kind in states]
told.append(heard.JourneyHeard(route_id=route.id, vehicle_id=train.id, stops=stops, **ops))
told.append(heard.RestrictionsHeard(restrictions=(heard.ToldRestriction(2500.0, 3000.0, limit_mps=20.0),), **ops))
told.append(heard.TargetsHeard(targets=(heard.Target(stop=b.name, arrival_ns=zero + 280 * S),), **ops))
told.append(heard.DelayHeard(delay_s=20.0, **ops))
told += [heard.NodeSeen(source="another node", there=there) for there in (True, False)]
said = [output for one in told for output in cab.hear(one)]
for now in range(zero, zero + 30 * S, S):  # The train stays where it is; put your own train and your own judge here.
    fix = PositionFix(time_ns=now, s_m=a.position_m, speed_mps=0.0, uncertainty_m=3.0, speed_uncertainty_mps=0.1)
    said += cab.hear(heard.PositionHeard(heard_ns=now, source="sensor", fix=fix))
    effort = Effort(time_ns=now, force_el_n=0.0, force_friction_n=0.0)
    said += cab.hear(heard.EffortHeard(heard_ns=now, source="control", effort=effort))
    said += cab.tick(now)  # The advice is the last of a tick.
advice = said[-1]
cab.close()
print(advice.mode.name, advice.guide.now, advice.reason, [one.text for one in said if isinstance(one, outputs.Event)])
