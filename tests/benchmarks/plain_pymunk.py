"""The same tractor as a user of pymunk would write it: plain Python, the `math` module and pymunk's own interface.

It has four wheels with Ackermann angles, tyres, the steering system and the speed controller at 60 Hz, guidance,
gates and the record at 10 Hz, and watches contacts. It knows forward gears only, which is all the benchmark drives,
and leaves out the clearance between outlines. That makes it faster than the full model, never slower.
"""

import math
from typing import Any

import pymunk

from vehicle.records import DT_S
from vehicle.sim.world import World

GRAVITY = 9.80665
CREEP_MPS = 0.05
ARRIVED_M = 0.08
HOLD, TRACK, SLEW = 1, 2, 3


def plain(record: Any) -> dict[str, Any]:
    """A numpy record as a dictionary of Python numbers."""
    return {name: record[name].item() for name in record.dtype.names}


class PlainTractor:
    """State, parameters and legs of one tractor as ordinary attributes."""

    def __init__(self, world: World, index: int) -> None:
        program = world.program
        state = program.states[index]
        self.body: pymunk.Body = world.bodies[index]
        self.model = plain(world.models[state["model"]])
        self.table = [table.tolist() for table in world.tables[state["model"]]]
        self.first, self.leg, self.last = int(state["first_leg"]), int(state["leg"]), int(state["last_leg"])
        self.segment = int(state["segment"])
        self.steering = self.command = self.target = self.reference = 0.0
        self.integral = self.last_error = self.progress = self.forward = 0.0
        self.stage, self.started, self.done = HOLD, False, False


class PlainWorld:
    """Drives the bodies of a World without any of its compiled code."""

    def __init__(self, world: World) -> None:
        program = world.program
        self.space = world.space
        world.boxes.required[:] = True
        world.boxes.update_space()
        self.every = world.steps_per_tick
        self.tractors = [PlainTractor(world, i) for i in range(len(world.bodies))]
        self.legs = [plain(leg) for leg in program.legs]
        self.gates = [(int(gate["tractor"]), float(gate["progress"])) for gate in program.gates]
        self.grounds = [plain(ground) for ground in world.grounds]
        self.points = [tuple(point) for point in program.points.tolist()]
        self.along = program.cumulative.tolist()
        self.record: list[tuple[float, ...]] = []
        self.contacts: list[Any] = []
        self.space.on_collision(None, None, begin=lambda arbiter, space, data: self.contacts.append(arbiter.shapes))

    def run(self, steps: int) -> None:
        """Advance by `steps` of 1/60 s."""
        for step in range(steps):
            if step % self.every == 0:
                for tractor in self.tractors:
                    self.control(tractor)
                for tractor in self.tractors:
                    x, y = tractor.body.position
                    row = (x, y, tractor.body.angle, tractor.steering, tractor.forward, tractor.leg - tractor.first)
                    self.record.append(row)
            for tractor in self.tractors:
                self.push(tractor)
            self.space.step(DT_S)

    def gates_open(self, leg: int) -> bool:
        for gate in range(self.legs[leg]["first_gate"], self.legs[leg]["last_gate"]):
            other, progress = self.gates[gate]
            if self.tractors[other].progress < progress and not self.tractors[other].done:
                return False
        return True

    def control(self, tractor: PlainTractor) -> None:
        if tractor.done or not (tractor.started or self.gates_open(tractor.leg)):
            tractor.target = 0.0
            return
        tractor.started = True
        self.steer(tractor)
        while tractor.leg < tractor.last:
            left = self.legs[tractor.leg]["end"] - tractor.progress
            arrived = left < 2 * ARRIVED_M and abs(tractor.forward) < 0.03
            if (left > 0.0 and not arrived) or not self.gates_open(tractor.leg + 1):
                break
            tractor.leg += 1
        tractor.target = self.allowed_speed(tractor)

    def steer(self, tractor: PlainTractor) -> None:
        model, leg, points, along = tractor.model, self.legs[tractor.leg], self.points, self.along
        angle, last, segment = tractor.body.angle, leg["last_segment"], tractor.segment
        x, y = tractor.body.position
        x += model["guide"] * math.cos(angle)
        y += model["guide"] * math.sin(angle)
        while True:
            (ax, ay, _), (bx, by, _) = points[segment], points[segment + 1]
            length = along[segment + 1] - along[segment]
            ux, uy = (bx - ax) / length, (by - ay) / length
            distance = (x - ax) * ux + (y - ay) * uy
            if distance <= length or segment >= last:
                break
            segment += 1
        tractor.segment = segment
        progress = along[segment] + distance
        tractor.progress = max(progress, tractor.progress)
        lateral = ux * (y - ay) - uy * (x - ax)
        ahead = progress + max(leg["lookahead"], model["lookahead_s"] * abs(tractor.forward))
        while segment < last and along[segment + 1] < ahead:
            segment += 1
        (ax, ay, _), (bx, by, _) = points[segment], points[segment + 1]
        share = (ahead - along[segment]) / (along[segment + 1] - along[segment])
        heading = angle - math.atan2(ay + share * (by - ay) - y, ax + share * (bx - ax) - x)
        heading = math.atan2(math.sin(heading), math.cos(heading))
        most = min(model["lateral_limit"], model["lateral_ease"] / max(abs(tractor.forward), 0.03))
        lateral = min(max(lateral, -most), most)
        command = model["lateral_gain"] * lateral + model["heading_gain"] * heading
        tractor.command = min(max(command, -model["lock"]), model["lock"])

    def allowed_speed(self, tractor: PlainTractor) -> float:
        deceleration = tractor.model["acceleration"]
        reach = 0.5 * tractor.forward**2 / deceleration + 1.0
        leg, speed = tractor.leg, min(self.legs[tractor.leg]["speed"], self.path_speed(tractor))
        while True:
            distance = self.legs[leg]["end"] - tractor.progress
            if leg == tractor.last or not self.gates_open(leg + 1):
                if distance < ARRIVED_M:
                    return 0.0
                return float(min(speed, max(math.sqrt(2 * deceleration * max(distance - ARRIVED_M, 0.0)), 0.12)))
            if distance > reach:
                return float(speed)
            speed = min(speed, math.sqrt(self.legs[leg + 1]["speed"] ** 2 + 2 * deceleration * max(distance, 0.0)))
            leg += 1

    def path_speed(self, tractor: PlainTractor) -> float:
        """Limit of the next point, from which it can brake, and of the wheels."""
        goal = tractor.segment + 1
        way, angle = self.along[goal] - tractor.progress, max(abs(tractor.command), abs(tractor.steering))
        limit = math.sqrt(self.points[goal][2] ** 2 + 1.6 * tractor.model["acceleration"] * max(way, 0.0))
        return min(limit, max(tractor.model["wheel_pace"] / angle, 1.0)) if angle > 0.0 else limit

    def push(self, tractor: PlainTractor) -> None:
        """Steering system, speed controller and tyres of one step; leaves the force and torque with the body."""
        body, model = tractor.body, tractor.model
        ground = self.legs[tractor.leg]["ground"]
        vx, vy = body.velocity
        angle, spin = body.angle, body.angular_velocity
        cosine, sine = math.cos(angle), math.sin(angle)
        forward, right = vx * cosine + vy * sine, vx * sine - vy * cosine
        tractor.forward = forward
        turn_wheels(tractor)
        drive = drive_force(tractor, forward, self.grounds[ground]["rolling"])
        table, limit = tractor.table[ground], model["lock"]
        place = (min(max(tractor.steering, -limit), limit) + limit) / (2 * limit) * (len(table) - 1)
        cell = min(int(place), len(table) - 2)
        tangent = math.tan(table[cell] * (1 - place + cell) + table[cell + 1] * (place - cell))
        new_forward, new_right, new_spin = advance(forward, right, -spin, tangent, drive, model, self.grounds[ground])
        turn = spin * DT_S
        small, odd = 1 - 0.5 * turn * turn, turn - turn**3 / 6
        ahead, aside = cosine * small - sine * odd, sine * small + cosine * odd
        scale = model["mass"] / DT_S
        body.force = (
            scale * (new_forward * ahead + new_right * aside - vx),
            scale * (new_forward * aside - new_right * ahead - vy),
        )
        body.torque = model["inertia"] / DT_S * (-new_spin - spin)


def turn_wheels(tractor: PlainTractor) -> None:
    """Eq. 2.8."""
    model = tractor.model
    gap = tractor.command - tractor.steering
    if abs(gap) < model["dead_band"]:
        tractor.stage = HOLD
        return
    if abs(gap) >= model["switch"]:
        tractor.stage = SLEW
    elif tractor.stage != SLEW:
        tractor.stage = TRACK
    if tractor.stage == SLEW:
        tractor.steering += math.copysign(min(model["rate"] * DT_S, abs(gap)), gap)
    else:
        share = DT_S / model["lag"]
        tractor.steering = tractor.steering * (1 - share) + tractor.command * share * model["gain"]


def drive_force(tractor: PlainTractor, forward: float, rolling: float) -> float:
    """Eq. 2.3, what the reference asks for at once, and the brake at rest."""
    model, step = tractor.model, tractor.model["acceleration"] * DT_S
    before = tractor.reference
    tractor.reference += min(max(tractor.target - tractor.reference, -step), step)
    error = tractor.reference - forward
    tractor.integral = min(max(tractor.integral + error * DT_S, -2.0), 2.0)
    slope, tractor.last_error = (error - tractor.last_error) / DT_S, error
    force = model["kp"] * error + model["ki"] * tractor.integral + model["kd"] * slope
    force = min(max(force, -model["max_drive"]), model["max_drive"])
    force += model["mass"] * (tractor.reference - before) / DT_S
    force += rolling * model["mass"] * GRAVITY * tractor.reference / (abs(tractor.reference) + 0.05)
    if tractor.target == 0.0 and tractor.reference == 0.0 and abs(forward) < 0.03:
        tractor.integral = 0.0
        force = -model["mass"] * forward / DT_S
    return float(min(max(force, -model["max_drive"]), model["max_drive"]))


def advance(
    forward: float, right: float, spin: float, tangent: float, drive: float, model: dict[str, Any],
    ground: dict[str, Any],
) -> tuple[float, float, float]:  # fmt: skip
    """Tyre forces of four wheels and the implicit step of vehicle.sim.dynamics."""
    front, rear, half, mass, inertia = (
        model["front"],
        model["rear"],
        model["track"] / 2,
        model["mass"],
        model["inertia"],
    )
    base, weight = front + rear, mass * GRAVITY
    side = turn = pull = d11 = d12 = d13 = d22 = d23 = d33 = 0.0
    for ahead, aside in ((front, -half), (front, half), (-rear, -half), (-rear, half)):
        if ahead > 0:
            steered = math.atan(base * tangent / (base - aside * tangent))
            slope, limit, load = ground["front_slope"], ground["front_limit"], 0.5 * weight * rear / base
        else:
            steered = 0.0
            slope, limit, load = ground["rear_slope"], ground["rear_limit"], 0.5 * weight * front / base
        cosine, sine = math.cos(steered), math.sin(steered)
        u, v = forward - aside * spin, right + ahead * spin
        rolling, sliding = max(abs(u * cosine + v * sine), CREEP_MPS), v * cosine - u * sine
        slip = math.atan(sliding / rolling)
        force = -slope * min(max(slip, -limit), limit) * load
        damping = slope * load * min(abs(slip), limit) / abs(sliding) if sliding else slope * load / rolling
        arm = ahead * cosine + aside * sine
        side += force * cosine
        turn += force * arm
        pull -= force * sine
        d11 += damping * sine * sine
        d12 -= damping * sine * cosine
        d13 -= damping * sine * arm
        d22 += damping * cosine * cosine
        d23 += damping * cosine * arm
        d33 += damping * arm * arm
    resistance = ground["rolling"] * weight * forward / (abs(forward) + 0.05)
    b1 = DT_S * (drive + pull - resistance + mass * right * spin)
    b2, b3 = DT_S * (side - mass * forward * spin), DT_S * turn
    share2, share3 = DT_S * d12 / (mass + DT_S * d11), DT_S * d13 / (mass + DT_S * d11)
    m22, m23 = mass + DT_S * (d22 - share2 * d12), DT_S * (d23 - share2 * d13)
    m33 = inertia + DT_S * (d33 - share3 * d13)
    c2, c3 = b2 - share2 * b1, b3 - share3 * b1
    size = m22 * m33 - m23 * m23
    more_right, more_spin = (m33 * c2 - m23 * c3) / size, (m22 * c3 - m23 * c2) / size
    more_forward = b1 / (mass + DT_S * d11) - share2 * more_right - share3 * more_spin
    return forward + more_forward, right + more_right, spin + more_spin
