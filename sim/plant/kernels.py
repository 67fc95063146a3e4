"""Numba kernels of the simulated train: the line under the train, one step, many steps. Inputs are not checked.

Symbols: x state, u command, p the train's numbers, a its actuators, c its losses, line and supply arrays of the route,
weather patches (see `sim.plant.plant`), s position of the head (m), v speed (m/s), dt step (s), f wheel force (N).
Traction > 0, brakes < 0. The kernels share no code with the solver.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import kernel
from das.domain.route import NEUTRAL
from das.domain.units import STANDARD_GRAVITY_MPS2

NO_LIMIT_N = 1e30
"""A force that no train reaches (finite, so that products stay defined)."""
FORCE, LEVER, SPEED = 0, 1, 2
"""Values of `Command.law`, which define the meaning of the command's `value`."""


class Command(NamedTuple):
    """The demand of the controller until the next command; create it with `force`, `lever` or `speed`.

    `law` is the meaning of `value`. FORCE: a wheel force (N); LEVER: a share of the largest traction (0 … 1) or of all
    brakes (−1 … 0) at the present speed on a dry rail; SPEED: a speed (m/s) to hold, which changes by `rate_mps2`, with
    `force_n` + `gain_per_s` × inertial mass × (wanted − actual speed). The force stays within `low_n` and `high_n`. The
    friction brake gives at least the share `friction_ratio` of a braking force.
    """

    law: int
    value: float
    rate_mps2: float = 0.0
    force_n: float = 0.0
    gain_per_s: float = 0.0
    low_n: float = -NO_LIMIT_N
    high_n: float = NO_LIMIT_N
    friction_ratio: float = 0.0


class PlantState(NamedTuple):
    """The train at a moment: time (s), position of the head (m), speed (m/s), acceleration (m/s²), wheel forces (N).

    `…_waited_s`: times for which traction, electric brake and friction brake have been demanded. Energies (J) count
    from the start. At the collector: `input_j`, `unreturned_j`. Consumed: `resistance_j` (running, tunnels, curves),
    `component_loss_j`, `auxiliary_j`, `friction_brake_j`. `comfort_j` is not part of `input_j`. `blending_j` is the
    part of `input_j` that would not have been needed if the motors had braked as much as they could.
    """

    time_s: float
    s_m: float
    speed_mps: float
    acceleration_mps2: float = 0.0
    force_el_n: float = 0.0
    force_friction_n: float = 0.0
    traction_waited_s: float = 0.0
    electric_waited_s: float = 0.0
    friction_waited_s: float = 0.0
    input_j: float = 0.0
    resistance_j: float = 0.0
    component_loss_j: float = 0.0
    auxiliary_j: float = 0.0
    friction_brake_j: float = 0.0
    unreturned_j: float = 0.0
    comfort_j: float = 0.0
    blending_j: float = 0.0


class TrainNumbers(NamedTuple):
    """The train's numbers for the kernels (SI; see `das.domain.vehicle.Vehicle`).

    The adhesive forces are for a dry rail, per unit of the adhesion coefficient; `rail_ratio` is the rail's state.
    `traction_curve` and `electric_curve` (n, 2) are effort curves: rising speeds with their largest forces, no rows if
    the train has no such curve.
    """

    mass_kg: float
    inertial_mass_kg: float
    length_m: float
    c0_n: float
    c1_n_per_mps: float
    c2_n_per_mps2: float
    traction_force_n: float
    traction_power_w: float
    electric_force_n: float
    electric_power_w: float
    friction_force_n: float
    adhesive_force_n: float
    braked_adhesive_force_n: float
    rail_ratio: float
    max_acceleration_mps2: float
    max_deceleration_mps2: float
    auxiliary_power_w: float
    comfort_power_w: float
    traction_curve: NDArray[np.float64]
    electric_curve: NDArray[np.float64]


class Actuator(NamedTuple):
    """The dead time (s) of a force and the rates at which it builds up and falls (N/s), for the kernels."""

    dead_s: float
    rise_n_per_s: float
    fall_n_per_s: float


class Actuators(NamedTuple):
    """The actuators of the forces for the kernels (see `sim.plant.plant.Dynamics`)."""

    traction: Actuator
    electric: Actuator
    friction: Actuator


class LossNumbers(NamedTuple):
    """A loss model in the form for the kernels; `table_w[i, j]` is the loss at the speed i/steps_per_mps and the force
    force0_n + j/steps_per_n.
    """

    is_map: bool
    traction_ratio: float
    brake_ratio: float
    idle_w: float
    steps_per_mps: float
    force0_n: float
    steps_per_n: float
    table_w: NDArray[np.float64]


class LineNumbers(NamedTuple):
    """A route under one train, for the kernels.

    `node_m` (n,) and `profile` (n, 9): gradient (ratio), curves (m/s²) and tunnels (N/(m/s)²) as means over the train
    with its head at s. The three columns of each are value and slope from the node on, and the integral up to it.
    `supply_start_m`, `supply` (k,): see `das.domain.route.Route.supply`.
    `weather` (w, 6): from and to (m), from and to (s), adhesion ratio, head wind (m/s).
    """

    node_m: NDArray[np.float64]
    profile: NDArray[np.float64]
    supply_start_m: NDArray[np.float64]
    supply: NDArray[np.float64]
    weather: NDArray[np.float64]


@kernel
def _segment(starts, s):
    """Index of the last start not beyond s (0 before the first)."""
    low, high = 0, starts.size
    while high - low > 1:
        middle = (low + high) // 2
        if starts[middle] <= s:
            low = middle
        else:
            high = middle
    return low


@kernel
def _integral(line, i, column, s):
    d = s - line.node_m[i]
    return line.profile[i, column + 2] + d * (line.profile[i, column] + 0.5 * d * line.profile[i, column + 1])


@kernel
def line_means(line, s, way):
    """Means over the train and the next `way` metres: gradient (ratio), curves (m/s²), tunnels (N/(m/s)²)."""
    i = _segment(line.node_m, s)
    if way <= 0.0:
        d = s - line.node_m[i]
        q = line.profile[i]
        return q[0] + d * q[1], q[3] + d * q[4], q[6] + d * q[7]
    j = i
    while j + 1 < line.node_m.size and line.node_m[j + 1] <= s + way:
        j += 1
    end = s + way
    return (
        (_integral(line, j, 0, end) - _integral(line, i, 0, s)) / way,
        (_integral(line, j, 3, end) - _integral(line, i, 3, s)) / way,
        (_integral(line, j, 6, end) - _integral(line, i, 6, s)) / way,
    )


@kernel
def weather_at(line, s, t, length):
    """State of the rail (1 = dry) and head wind (m/s) for a train with its head at s; a patch counts with the share
    of the train that is in it."""
    rail, wind = 1.0, 0.0
    for k in range(line.weather.shape[0]):
        patch = line.weather[k]
        if not patch[2] <= t < patch[3]:
            continue
        if length > 0.0:
            share = max(min(s, patch[1]) - max(s - length, patch[0]), 0.0) / length
        else:
            share = 1.0 if patch[0] <= s < patch[1] else 0.0
        rail *= 1.0 - share * (1.0 - patch[4])
        wind += share * patch[5]
    return rail, wind


@kernel
def supply_at(line, s, way):
    """The lowest supply value on the next `way` metres ahead of the head."""
    i = _segment(line.supply_start_m, s)
    least = line.supply[i]
    while i + 1 < line.supply.size and line.supply_start_m[i + 1] < s + way:
        i += 1
        least = min(least, line.supply[i])
    return least


@kernel
def adhesion_coefficient(v):
    """µ of a dry rail, Curtius & Kniffler 1944: 0.161 + 7.5/(V + 44), V in km/h."""
    return 0.161 + 7.5 / (3.6 * v + 44.0)


@kernel
def _motors(v, force, power, curve):
    """Largest force (N) of the motors at a speed: the least by force, power and effort curve (if there is one)."""
    most = force if v * force <= power else power / v
    if curve.shape[0] == 0:
        return most
    if v >= curve[-1, 0]:
        return min(most, curve[-1, 1])
    i = _segment(curve[:, 0], v)
    share = (v - curve[i, 0]) / (curve[i + 1, 0] - curve[i, 0])
    return min(most, (1.0 - share) * curve[i, 1] + share * curve[i + 1, 1])


@kernel
def traction_effort(v, rail, p):
    """Largest traction force (N) at a speed, for a state of the rail (1 = dry)."""
    adhesive = rail * p.adhesive_force_n * adhesion_coefficient(v)
    return min(_motors(v, p.traction_force_n, p.traction_power_w, p.traction_curve), adhesive)


@kernel
def electric_effort(v, rail, p):
    """Largest force of the electric brake (N)."""
    adhesive = rail * p.adhesive_force_n * adhesion_coefficient(v)
    return min(_motors(v, p.electric_force_n, p.electric_power_w, p.electric_curve), adhesive)


@kernel
def brake_effort(v, rail, p):
    """Largest force of both brakes together (N): the friction brake works on every axle."""
    both = electric_effort(v, rail, p) + p.friction_force_n
    return min(both, rail * p.braked_adhesive_force_n * adhesion_coefficient(v))


@kernel
def efforts(v, rail, p):
    """Largest force (N) of traction, of the electric brake and of both brakes."""
    return traction_effort(v, rail, p), electric_effort(v, rail, p), brake_effort(v, rail, p)


@kernel
def running_resistance(v, wind, tunnel, p):
    """Resistance (N), c0 + c1·v + c2·(v + w)·|v + w| + q·v². A tail wind faster than the train
    pushes it; the tunnels' term ignores the wind.
    """
    air = v + wind
    return p.c0_n + p.c1_n_per_mps * v + p.c2_n_per_mps2 * air * abs(air) + tunnel * v * v


@kernel
def loss_power(f, v, c):
    """Loss of the traction chain (W) at wheel force f and speed v; 0 at a standstill. Bilinear in a map."""
    if v <= 0.0:
        return 0.0
    if not c.is_map:
        power = f * v
        return c.idle_w + (c.traction_ratio * power if power >= 0.0 else -c.brake_ratio * power)
    x = v * c.steps_per_mps
    y = (f - c.force0_n) * c.steps_per_n
    i = min(max(int(x), 0), c.table_w.shape[0] - 2)
    j = min(max(int(y), 0), c.table_w.shape[1] - 2)
    low = c.table_w[i, j] + (y - j) * (c.table_w[i, j + 1] - c.table_w[i, j])
    high = c.table_w[i + 1, j] + (y - j) * (c.table_w[i + 1, j + 1] - c.table_w[i + 1, j])
    return low + (x - i) * (high - low)


@kernel
def demanded(u, into, v, p):
    """Wheel force (N) that a command requests, `into` s after it was given, at a speed."""
    if u.law == LEVER:
        effort = traction_effort(v, 1.0, p) if u.value >= 0.0 else brake_effort(v, 1.0, p)
        force = u.value * effort
    elif u.law == SPEED:
        wanted = max(u.value + u.rate_mps2 * into, 0.0)
        force = u.force_n + u.gain_per_s * p.inertial_mass_kg * (wanted - v)
    else:
        force = u.value
    return min(max(force, u.low_n), u.high_n)


@kernel
def _built_up(before, target, waited, actuator, dt):
    """Magnitude (N) of a force after a step: it begins to fall immediately, but to rise only after its dead time."""
    if target <= before:
        return max(target, before - actuator.fall_n_per_s * dt)
    usable = dt if before > 0.0 else min(max(waited + dt - actuator.dead_s, 0.0), dt)
    return min(target, before + actuator.rise_n_per_s * usable)


@kernel
def _shared(asked, friction_ratio, v, rail, supply, p):
    """Magnitudes (N) of traction, electric brake and friction brake that together give a force.

    The electric brake is used first, up to its share, and beyond that if the friction brake cannot supply the rest.
    """
    pulls = min(max(asked, 0.0), 0.0 if supply == NEUTRAL else traction_effort(v, rail, p))
    brakes = min(max(-asked, 0.0), brake_effort(v, rail, p))
    its_share = max((1.0 - friction_ratio) * brakes, brakes - p.friction_force_n)
    electric = min(its_share, electric_effort(v, rail, p) if supply >= 0.0 else 0.0)
    return pulls, electric, min(brakes - electric, p.friction_force_n)


@kernel
def step(x, u, began, into, dt, line, p, a, c):
    """The state one step later; the step begins `into` s after the command, which was given at time `began`.

    Midpoint rule (second order) with a constant acceleration within the step. Line forces are exact means over the
    train and the step's distance. The weather is that at the start of the step. The supply is the lowest under the head
    during the step, so a neutral section, a zone without regeneration or a lower receptivity applies from the step that
    reaches it. Braking energy is booked where it ends up, to close the energy balance.
    """
    v0 = x.speed_mps
    rail, wind = weather_at(line, x.s_m, x.time_s, p.length_m)
    rail *= p.rail_ratio
    supply = supply_at(line, x.s_m, v0 * dt)

    # Forces that can still be held at the start of the step, and the motion that they would cause.
    el0 = min(x.force_el_n, 0.0 if supply == NEUTRAL else traction_effort(v0, rail, p))
    el0 = max(el0, -electric_effort(v0, rail, p) if supply >= 0.0 else 0.0)
    fr0 = max(x.force_friction_n, min(-brake_effort(v0, rail, p) - el0, 0.0))
    grade, curve, tunnel = line_means(line, x.s_m, v0 * dt)
    pull0 = el0 + fr0 - running_resistance(v0, wind, tunnel, p) - p.mass_kg * (STANDARD_GRAVITY_MPS2 * grade + curve)
    a0 = pull0 / p.inertial_mass_kg
    middle = max(v0 + 0.5 * a0 * dt, 0.0)
    ahead = max(v0 + a0 * dt, 0.0)
    grade, curve, tunnel = line_means(line, x.s_m, 0.5 * (v0 + ahead) * dt)
    weight = p.mass_kg * STANDARD_GRAVITY_MPS2 * grade
    resistance = running_resistance(middle, wind, tunnel, p) + p.mass_kg * curve

    # The force demanded at the end of the step, and its shares for motors and friction brake.
    asked = demanded(u, into + dt, ahead, p)
    asked = min(asked, max(p.inertial_mass_kg * p.max_acceleration_mps2 + resistance + weight, 0.0))
    asked = max(asked, min(-p.inertial_mass_kg * p.max_deceleration_mps2 + resistance + weight, 0.0))
    pulls, electric, rubs = _shared(asked, u.friction_ratio, ahead, rail, supply, p)

    # The build-up of each force; the motors either pull or brake.
    pulled = _built_up(max(el0, 0.0), pulls if el0 >= 0.0 else 0.0, x.traction_waited_s, a.traction, dt)
    braked = _built_up(max(-el0, 0.0), electric if el0 <= 0.0 else 0.0, x.electric_waited_s, a.electric, dt)
    rubbed = _built_up(-fr0, rubs, x.friction_waited_s, a.friction, dt)
    el1 = pulled - braked
    el = max(min(0.5 * (el0 + el1), traction_effort(middle, rail, p)), -electric_effort(middle, rail, p))
    fr = max(0.5 * (fr0 - rubbed), min(-brake_effort(middle, rail, p) - el, 0.0))

    # Motion. A standing train stays where it is until traction moves it.
    rate = (el + fr - resistance - weight) / p.inertial_mass_kg
    moving = dt
    v1 = v0 + rate * dt
    if v0 <= 0.0 and (el <= 0.0 or rate <= 0.0):
        moving = 0.0
        rate = 0.0
        v1 = 0.0
    elif v1 < 0.0:
        moving = v0 / -rate
        v1 = 0.0
    way = 0.5 * (v0 + v1) * moving
    if v1 <= 0.0:
        el1 = pulled  # motors cannot brake at a standstill

    loss_j = loss_power(el, 0.5 * (v0 + v1), c) * moving
    auxiliary_j = p.auxiliary_power_w * dt
    gross_j = el * way + loss_j + auxiliary_j
    taken = 1.0 if gross_j > 0.0 else max(supply, 0.0)
    blended_j = 0.0
    if fr < 0.0:  # The same motion, with as much force from the motors as possible.
        motors = max(el + fr, -electric_effort(middle, rail, p) if supply >= 0.0 else 0.0)
        best_j = motors * way + loss_power(motors, 0.5 * (v0 + v1), c) * moving + auxiliary_j
        blended_j = taken * gross_j - (1.0 if best_j > 0.0 else max(supply, 0.0)) * best_j
    return PlantState(
        began + into + dt,
        x.s_m + way,
        v1,
        rate,
        el1,
        0.0 - rubbed,
        x.traction_waited_s + dt if pulls > 0.0 else 0.0,
        x.electric_waited_s + dt if electric > 0.0 else 0.0,
        x.friction_waited_s + dt if rubs > 0.0 else 0.0,
        x.input_j + taken * gross_j,
        x.resistance_j + resistance * way,
        x.component_loss_j + loss_j,
        x.auxiliary_j + auxiliary_j,
        x.friction_brake_j - fr * way,
        x.unreturned_j - (1.0 - taken) * gross_j,
        x.comfort_j + p.comfort_power_w * dt,
        x.blending_j + blended_j,
    )


@kernel
def advance(x, u, steps, dt, line, p, a, c):
    """The state after `steps` steps under one command."""
    began = x.time_s
    for i in range(steps):
        x = step(x, u, began, i * dt, dt, line, p, a, c)
    return x
