"""A freight train of a user's own, which needs its brakes: 1350 t on a line with steep descents or late boards."""

FREIGHT = """
schema_version = 1
resistance = {c0_kn = 22, c1_kn_per_mps = 0.15, c2_kn_per_mps2 = 0.055}
traction = {max_force_kn = 300, max_power_kw = 5600}
electric_brake = {max_force_kn = 150, max_power_kw = 2600}
friction_brake.max_force_kn = 320
brakes.policy = "blended"
service_brake = {deceleration_mps2 = 0.15, build_up_s = 6}
losses = {default = "own", own = {mean_efficiency_ratio = 0.85, idle_kw = 20}}
[vehicle]
id = "freight"
name = "freight"
source = "invented"
mass_t = 1350
rotating_mass_ratio = 0.05
length_m = 520
max_speed_kmh = 100
"""
