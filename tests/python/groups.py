"""Writes groups of videos with one hidden effect, simulated by four engines: `pip install mujoco pymunk pybullet Box2D numpy`.

    groups.py DIR [--engine mujoco,pymunk,bullet,box2d] [--kinds a,b|library|outside|rivals|control] [--strength 1.0] [--seeds 1,2]
        [--noise 0.005] [--lost 0.1]        noise of a position (m), and the share of its frames in which each object is lost
    groups.py --check        what the simulations do at contacts and on the table, without any hidden effect

A group is four videos of 128 frames of 4 to 6 discs, balls and cubes, 5 mm noise; the layout is that of the benchmark's
`effects` worlds. The engines do what happens at contacts. The table under the objects is Coulomb friction at the points of each
foot, balls that slide until they roll, or an air table; nothing else is hidden. Bullet, in space, has a table of its own.
`cargo run --release --example discovery_figures -- DIR` tells what discovery makes of them.
"""
import argparse, itertools, json, math, pathlib
import numpy as np

FPS, FRAMES, G, SIZE = 25, 128, 9.81, 0.2
DENSITY = {"sphere": (0.42, 1.05), "cylinder": (0.6, 1.5), "cube": (0.78, 1.95)}  # kg of rubber, metal
MOMENT = {"sphere": 0.4, "cylinder": 0.5, "cube": 2 / 3}  # over m SIZE^2
SLIDE_MU = 0.15  # of a ball that does not roll
SLOW = {"sphere": 0.004, "cylinder": 0.001, "cube": 0.001}  # slip below which friction is viscous (m/s)


def perp(v):
    return np.stack([-v[..., 1], v[..., 0]], -1)


def pairs_force(x, strength, eps):
    d = x[None] - x[:, None]
    return strength * (d / ((d ** 2).sum(-1, keepdims=True) + eps ** 2) ** 1.5).sum(1)


def laws(rng, s):
    """By kind: parameters, and the force on all bodies as f(x, v, w, m, t) where it is one."""
    way = lambda size: size * np.array([math.cos(a := rng.uniform(0, 2 * math.pi)), math.sin(a)])
    near = rng.uniform(-0.8, 0.8, 2)
    u = s * rng.uniform(0.8, 1.25)
    wind, slope, swing = way(0.085 * u), way(0.085 * u), way(0.12 * u)
    f, phase, axis = rng.uniform(0.35, 0.8), rng.uniform(0, 6.28), way(1.0)
    spring = rng.random() < 0.5
    pull = lambda d: 0.08 * u * d if spring else 0.12 * u * d / ((d ** 2).sum(-1, keepdims=True) + 0.09) ** 1.5
    col = lambda a: a[:, None]
    speed = lambda v: np.linalg.norm(v, axis=1)
    turned = lambda v: np.outer(v @ axis, axis)
    source = {"form": "spring", "k": 0.08 * u} if spring else {"form": "inverse_square", "S": 0.12 * u, "eps": 0.3}
    pairs = {"S": 0.116 * u, "eps": 0.3}
    forces = {  # F(x, v, w, m, t)
        "linear_drag": ({"c": 0.2 * u}, lambda x, v, w, m, t: -0.2 * u * v),
        "quadratic_drag": ({"c": 0.28 * u}, lambda x, v, w, m, t: -0.28 * u * col(speed(v)) * v),
        "uniform_force": ({"F": [*wind]}, lambda x, v, w, m, t: wind + 0 * v),
        "tilt": ({"a": [*slope]}, lambda x, v, w, m, t: col(m) * slope),
        "attractor": ({"center": [*near], **source}, lambda x, v, w, m, t: pull(near - x)),
        "vortex": ({"center": [*near], "c": 0.2 * u, "Omega": 0.6}, lambda x, v, w, m, t: -0.2 * u * (v - 0.6 * perp(x - near))),
        "coriolis": ({"Omega": 0.083 * u}, lambda x, v, w, m, t: -2 * 0.083 * u * col(m) * perp(v)),
        "lateral": ({"b": 0.15 * u}, lambda x, v, w, m, t: 0.15 * u * perp(v)),
        "magnus": ({"S": 0.08 * u}, lambda x, v, w, m, t: 0.08 * u * col(w) * perp(v)),
        "pair_attraction": (pairs, lambda x, v, w, m, t: pairs_force(x, 0.116 * u, 0.3)),
        "pair_repulsion": (pairs, lambda x, v, w, m, t: pairs_force(x, -0.116 * u, 0.3)),
        "time_periodic": ({"a": 0.12 * u, "f": f, "phi": (phase + math.pi * (swing[0] < 0)) % (2 * math.pi)}, lambda x, v, w, m, t: np.outer(m, swing) * math.cos(2 * math.pi * f * t + phase)),
        "cubic_drag": ({"c": 0.3 * u}, lambda x, v, w, m, t: -0.3 * u * col(speed(v) ** 2) * v),
        # No library lists these.
        "quartic_drag": ({"c": 0.3 * u}, lambda x, v, w, m, t: -0.3 * u * col(speed(v) ** 3) * v),
        "saddle": ({"k": 0.08 * u}, lambda x, v, w, m, t: 0.08 * u * col(m) * (2 * turned(x) - x)),
        "growing_wind": ({"b": 0.04 * u}, lambda x, v, w, m, t: 0.04 * u * t * np.outer(m, axis)),
        "inverse_distance": ({"center": [*near], "S": 0.12 * u}, lambda x, v, w, m, t: 0.12 * u * (near - x) / ((near - x) ** 2).sum(-1, keepdims=True).clip(0.05 ** 2)),
        "anisotropic_drag": ({"c": 0.25 * u}, lambda x, v, w, m, t: -0.25 * u * turned(v)),
    }
    normal = way(1.0)
    tilt, arm = 0.02 * u * axis, 0.05 * u * normal
    others = {
        "friction_patch": {"center": [*near], "radius": rng.uniform(0.7, 1.1), "k": 1 + 2.5 * u},
        "hidden_wall": {"point": [*(-1.1 * normal)], "normal": [*normal], "restitution": rng.uniform(0.5, 0.9)},
        "hidden_object": {"center": [*near], "radius": rng.uniform(0.2, 0.35), "restitution": rng.uniform(0.5, 0.9)},
        "contact_friction": {"mu": 0.3 * u},
        "mass_change": {"object_id": 0, "factor": 1 + u},
        "speed_dependent_restitution": {"v0": 1.3 / u},
        "sticky_contact": {},
        "soft_contact": {"duration": 0.1 * u},
        # No physics, but the measurement or the stated mass is wrong; of an object: of the first, a marker is never on a ball.
        "wrong_scale": {"scale": 1 + 0.06 * u},
        "tilted_camera": {"h": [*tilt]},
        "off_centre_marker": {"object_id": 0, "arm": [*arm]},
        "wrong_size": {"object_id": 0, "factor": 1 + 0.25 * u},
        "none": {},
    }
    return forces | {k: (p, None) for k, p in others.items()}


OUTSIDE = ["quartic_drag", "saddle", "growing_wind", "inverse_distance", "anisotropic_drag"]
RIVALS = ["wrong_scale", "tilted_camera", "off_centre_marker", "wrong_size"]
ONLY = {"soft_contact": ["mujoco"], "speed_dependent_restitution": ["pymunk", "box2d"], "sticky_contact": ["pymunk"]}


class MuJoCo:
    """Bodies in the plane; a contact is a spring and damper of the wanted duration and restitution."""
    def __init__(self, bodies, world, kind, params):
        import mujoco
        self.mj, self.dt = mujoco, 0.0005

        def solref(e, duration=0.008):
            z = -math.log(e) / math.hypot(math.pi, math.log(e))
            omega = math.pi / duration / math.sqrt(1 - z * z)
            return f"{-omega ** 2} {-2 * z * omega}"

        mu = params.get("mu", 0)
        hard = solref(world["restitution"], params.get("duration", 0.008))
        geom = f'solref="{hard}" solimp="0.99 0.99 0.001" condim="{3 if mu else 1}" friction="{mu} 0 0"'
        wall = f'solref="{solref(params.get("restitution", 1))}" solimp="0.99 0.99 0.001" priority="1" condim="1"'
        xml = '<mujoco><option gravity="0 0 0" timestep="0.0005" cone="elliptic"/><worldbody>'
        if kind == "hidden_wall":
            (px, py), (nx, ny) = params["point"], params["normal"]
            xml += f'<geom type="plane" pos="{px} {py} 0" zaxis="{nx} {ny} 0" size="9 9 1" {wall}/>'
        if kind == "hidden_object":
            x, y = params["center"]
            xml += f'<geom type="sphere" pos="{x} {y} 0" size="{params["radius"]}" {wall}/>'
        for b in bodies:
            i = b["inertia"]
            box = b["shape"] == "cube"
            size = f"{SIZE} {SIZE} {SIZE}" if box else f"{SIZE}"
            xml += (f'<body><inertial pos="0 0 0" mass="{b["mass"]}" diaginertia="{i} {i} {i}"/><joint type="slide" axis="1 0 0"/>'
                    f'<joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/><geom type="{"box" if box else "sphere"}" size="{size}" {geom}/></body>')
        self.model = mujoco.MjModel.from_xml_string(xml + "</worldbody></mujoco>")
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = np.concatenate([[*b["x"], b["yaw"]] for b in bodies])
        self.data.qvel[:] = np.concatenate([[*b["v"], b["w"]] for b in bodies])

    def state(self):
        q, v = self.data.qpos.reshape(-1, 3), self.data.qvel.reshape(-1, 3)
        return q[:, :2].copy(), q[:, 2].copy(), v[:, :2].copy(), v[:, 2].copy()

    def step(self, force, torque):
        self.data.qfrc_applied[:] = np.concatenate([force, torque[:, None]], 1).ravel()
        self.mj.mj_step(self.model, self.data)


class Pymunk:
    """Bodies in the plane; contacts are impulses."""
    def __init__(self, bodies, world, kind, params):
        import pymunk
        self.dt, self.space = 0.001, pymunk.Space()
        self.space.iterations, self.space.collision_slop = 30, 0.0005
        root, joined = math.sqrt(world["restitution"]), set()
        self.bodies, still, hidden = [], self.space.static_body, None
        for b in bodies:
            body = pymunk.Body(b["mass"], b["inertia"])
            body.position, body.angle, body.velocity, body.angular_velocity = (*b["x"],), b["yaw"], (*b["v"],), b["w"]
            shape = pymunk.Poly.create_box(body, (2 * SIZE, 2 * SIZE)) if b["shape"] == "cube" else pymunk.Circle(body, SIZE)
            shape.elasticity, shape.friction = root, math.sqrt(params.get("mu", 0))
            self.space.add(body, shape)
            self.bodies.append(body)
        if kind == "hidden_wall":
            p, n = np.array(params["point"]), np.array(params["normal"])
            hidden = pymunk.Segment(still, tuple(p - 0.5 * n + 9 * perp(n)), tuple(p - 0.5 * n - 9 * perp(n)), 0.5)
        if kind == "hidden_object":
            hidden = pymunk.Circle(still, params["radius"], tuple(params["center"]))
        if hidden:
            hidden.elasticity = params["restitution"] / root
            self.space.add(hidden)

        def fade(arbiter, space, data):
            a, b = (s.body for s in arbiter.shapes)
            if arbiter.is_first_contact:
                approach = abs((b.velocity - a.velocity).dot(arbiter.normal))
                arbiter.restitution = world["restitution"] * math.exp(-approach / params["v0"])

        def stick(arbiter, space, data):
            a, b = (s.body for s in arbiter.shapes)
            if (a, b) not in joined and arbiter.contact_point_set.points:
                joined.update([(a, b), (b, a)])
                # What is glued does not roll.
                for body in (a, b):
                    bodies[self.bodies.index(body)]["glued"] = True
                at = arbiter.contact_point_set.points[0].point_a
                joints = pymunk.PivotJoint(a, b, at), pymunk.GearJoint(a, b, b.angle - a.angle, 1)
                space.add_post_step_callback(lambda s, k: s.add(*joints), (a, b))

        def as_one(arbiter, space, data):
            arbiter.process_collision = tuple(s.body for s in arbiter.shapes) not in joined

        hooks = {"speed_dependent_restitution": {"pre_solve": fade}, "sticky_contact": {"pre_solve": as_one, "post_solve": stick}}
        self.space.on_collision(**hooks.get(kind, {}))

    def state(self):
        rows = np.array([(*b.position, b.angle, *b.velocity, b.angular_velocity) for b in self.bodies])
        return rows[:, :2], rows[:, 2], rows[:, 3:5], rows[:, 5]

    def step(self, force, torque):
        for body, f, t in zip(self.bodies, force, torque):
            body.force, body.torque = (*f,), t
        self.space.step(self.dt)


class Bullet:
    """Bodies in space, on a plane with friction; contacts are impulses. Friction and restitution are products of both bodies'."""
    def __init__(self, bodies, world, kind, params):
        import pybullet
        self.dt = 0.002
        self.pb, self.client = pybullet, pybullet.connect(pybullet.DIRECT)
        self.call("setGravity", 0, 0, -G)
        self.call("setPhysicsEngineParameter", fixedTimeStep=self.dt, numSolverIterations=50, restitutionVelocityThreshold=0.01,
                  contactERP=0.02)
        self.mu, self.params = world["mu"], params if kind == "friction_patch" else None
        root, self.contact_mu = math.sqrt(world["restitution"]), math.sqrt(params.get("mu", 0))
        plane = self.still(self.call("createCollisionShape", self.pb.GEOM_PLANE), 0)
        # The same friction for all, where that of contacts is asked for.
        self.call("changeDynamics", plane, -1, lateralFriction=self.mu["metal"] / self.contact_mu if self.contact_mu else 1)
        box = lambda *half: self.call("createCollisionShape", self.pb.GEOM_BOX, halfExtents=half)
        round_ = lambda r: self.call("createCollisionShape", self.pb.GEOM_CYLINDER, radius=r, height=2 * SIZE)
        if kind == "hidden_wall":
            n, turn = np.array(params["normal"]), math.atan2(params["normal"][1], params["normal"][0])
            self.still(box(0.5, 9, 1), params["restitution"] / root, np.array(params["point"]) - 0.5 * n, turn)
        if kind == "hidden_object":
            self.still(round_(params["radius"]), params["restitution"] / root, params["center"])
        shapes = {"cube": lambda: box(SIZE, SIZE, SIZE), "cylinder": lambda: round_(SIZE),
                  "sphere": lambda: self.call("createCollisionShape", self.pb.GEOM_SPHERE, radius=SIZE)}
        self.bodies, self.looks = [], bodies
        for b in bodies:
            turn = self.pb.getQuaternionFromEuler([0, 0, b["yaw"]])
            body = self.call("createMultiBody", b["mass"], shapes[b["shape"]](), -1, [*b["x"], SIZE], turn)
            self.call("changeDynamics", body, -1, restitution=root, linearDamping=0, angularDamping=0, contactProcessingThreshold=0)
            if b["shape"] == "sphere" and not b["rolls"]:
                self.call("changeDynamics", body, -1, localInertiaDiagonal=[0, 0, 0])
            spin = [*perp(b["v"]) / SIZE] if b["rolls"] else [0, 0]
            self.call("resetBaseVelocity", body, [*b["v"], 0], [*spin, b["w"]])
            self.bodies.append(body)
            self.set_friction(b, body, 1)

    def __del__(self):
        self.pb.disconnect(self.client)

    def call(self, name, *words, **named):
        return getattr(self.pb, name)(*words, **named, physicsClientId=self.client)

    def still(self, shape, restitution, at=(0, 0), turn=0.0):
        body = self.call("createMultiBody", 0, shape, -1, [*at, 0], self.pb.getQuaternionFromEuler([0, 0, turn]))
        self.call("changeDynamics", body, -1, lateralFriction=0.0, restitution=restitution, contactProcessingThreshold=0)
        return body

    def set_friction(self, b, body, factor):
        mu = factor * self.mu[b["material"]]
        slide = SLIDE_MU if b["rolls"] else mu
        self.call("changeDynamics", body, -1, lateralFriction=self.contact_mu or slide, rollingFriction=1.4 * SIZE * mu if b["rolls"] else 0)

    def state(self):
        places = [self.call("getBasePositionAndOrientation", b) for b in self.bodies]
        speeds = [self.call("getBaseVelocity", b) for b in self.bodies]
        x, v = (np.array([p[0][:2] for p in rows]) for rows in (places, speeds))
        return x, np.array([self.pb.getEulerFromQuaternion(q)[2] for _, q in places]), v, np.array([w[2] for _, w in speeds])

    def step(self, force, torque):
        for b, body, push in zip(self.looks, self.bodies, force):
            at = self.call("getBasePositionAndOrientation", body)[0]
            if self.params:
                inside = math.dist(at[:2], self.params["center"]) < self.params["radius"]
                self.set_friction(b, body, self.params["k"] if inside else 1)
            self.call("applyExternalForce", body, -1, [*push, 0], at, self.pb.WORLD_FRAME)
        self.call("stepSimulation")


class Box2D:
    """Bodies in the plane; contacts are impulses. Lengths are the engine's divided by SCALE: below 1 m/s it lets nothing bounce."""
    SCALE = 25.0

    def __init__(self, bodies, world, kind, params):
        import Box2D
        self.b2, self.dt, self.bodies, s = Box2D, 0.002, [], self.SCALE

        class Contacts(Box2D.b2ContactListener):
            def PreSolve(self, contact, old):
                # Of two restitutions the engine takes the larger; what is hidden has its own.
                if "restitution" in params:
                    still = not contact.fixtureA.body.mass or not contact.fixtureB.body.mass
                    contact.restitution = params["restitution"] if still else world["restitution"]
                if kind == "speed_dependent_restitution" and not old.pointCount:
                    a, b, found = contact.fixtureA.body, contact.fixtureB.body, contact.manifold
                    # Round things along the line of centres, others along a face; the binding's own normal is not to be used.
                    flat = {Box2D.b2Manifold.e_faceA: a, Box2D.b2Manifold.e_faceB: b}.get(found.type_)
                    normal = flat.GetWorldVector(found.localNormal) if flat else b.worldCenter - a.worldCenter
                    at = contact.worldManifold.points[0]
                    slip = b.GetLinearVelocityFromWorldPoint(at) - a.GetLinearVelocityFromWorldPoint(at)
                    approach = abs(slip.dot(normal)) / normal.length / s
                    contact.restitution = world["restitution"] * math.exp(-approach / params["v0"])

        self.contacts = Contacts()
        self.world = Box2D.b2World(gravity=(0, 0), doSleep=False, contactListener=self.contacts)
        for b in bodies:
            shape = Box2D.b2PolygonShape(box=(SIZE * s, SIZE * s)) if b["shape"] == "cube" else Box2D.b2CircleShape(radius=SIZE * s)
            body = self.world.CreateDynamicBody(position=[*(s * b["x"])], angle=b["yaw"], linearVelocity=[*(s * b["v"])], angularVelocity=b["w"])
            body.CreateFixture(shape=shape, density=1, restitution=world["restitution"], friction=params.get("mu", 0))
            body.massData = Box2D.b2MassData(mass=b["mass"], center=(0, 0), I=b["inertia"] * s * s)
            self.bodies.append(body)
        if kind == "hidden_wall":
            p, n = np.array(params["point"]), np.array(params["normal"])
            wall = self.world.CreateStaticBody(position=[*(s * (p - 0.5 * n))], angle=math.atan2(n[1], n[0]))
            wall.CreateFixture(shape=Box2D.b2PolygonShape(box=(0.5 * s, 9 * s)), restitution=params["restitution"], friction=0)
        if kind == "hidden_object":
            still = self.world.CreateStaticBody(position=[*(s * np.array(params["center"]))])
            still.CreateFixture(shape=Box2D.b2CircleShape(radius=params["radius"] * s), restitution=params["restitution"], friction=0)

    def state(self):
        rows = np.array([(*b.worldCenter, b.angle, *b.linearVelocity, b.angularVelocity) for b in self.bodies])
        return rows[:, :2] / self.SCALE, rows[:, 2], rows[:, 3:5] / self.SCALE, rows[:, 5]

    def step(self, force, torque):
        for body, f, t in zip(self.bodies, force * self.SCALE, torque * self.SCALE ** 2):
            body.ApplyForceToCenter([*f], True)
            body.ApplyTorque(t, True)
        self.world.Step(self.dt, 30, 20)


ENGINES = {"mujoco": MuJoCo, "pymunk": Pymunk, "bullet": Bullet, "box2d": Box2D}
CORNERS = SIZE * np.array(list(itertools.product([1, -1], [1, -1])))
RIM = SIZE * np.array([(r * math.cos(a), r * math.sin(a)) for r in (0.35, 0.65, 0.92) for a in np.arange(8) * math.pi / 4])
RIM_SHARE = np.repeat(np.array([0.25, 0.42, 0.84]), 8) / (8 * 1.51)


def table_friction(bodies, x, yaw, v, w, roll, mu, dt):
    """Force and torque of the table on each body; moves the balls' roll."""
    force, torque = np.zeros_like(x), np.zeros(len(bodies))
    for k, b in enumerate(bodies):
        weight, slow = b["mass"] * G, SLOW[b["shape"]]
        if b["shape"] == "sphere":
            slip = v[k] + SIZE * perp(roll[k]) if b["rolls"] and "glued" not in b else v[k]
            grip = SLIDE_MU if b["rolls"] else mu[k]
            force[k] = -grip * weight * slip / np.hypot(np.linalg.norm(slip), slow)
            if b["rolls"] and "glued" not in b:
                # The slip is v + SIZE perp(roll); resistance to rolling is a couple.
                turn = 2.5 / (b["mass"] * SIZE) * perp(-force[k])
                roll[k] += dt * (turn - 3.5 * mu[k] * G / SIZE * roll[k] / np.hypot(np.linalg.norm(roll[k]), 0.02))
            continue
        c, s = math.cos(yaw[k]), math.sin(yaw[k])
        points, share = (CORNERS, 0.25) if b["shape"] == "cube" else (RIM, RIM_SHARE[:, None])
        arm = points @ np.array([[c, s], [-s, c]])
        slip = v[k] + w[k] * perp(arm)
        pull = -mu[k] * weight * share * slip / np.sqrt((slip ** 2).sum(1, keepdims=True) + slow ** 2)
        force[k], torque[k] = pull.sum(0), (arm[:, 0] * pull[:, 1] - arm[:, 1] * pull[:, 0]).sum()
    return force, torque


def simulate(engine, bodies, world, kind, law, frames=FRAMES, seen=None):
    params, push = law
    heavy = [dict(b) for b in bodies]
    if kind == "mass_change":
        heavy[0]["mass"] *= params["factor"]
        heavy[0]["inertia"] *= params["factor"]
    run, rows = ENGINES[engine](heavy, world, kind, params), []
    mass = np.array([b["mass"] for b in heavy])
    plain = np.array([world["mu"][b["material"]] for b in bodies])
    roll = np.array([perp(b["v"]) / SIZE if b["rolls"] else np.zeros(2) for b in bodies])
    steps = round(1 / FPS / run.dt)
    for k in range((frames - 1) * steps + 1):
        x, yaw, v, w = run.state()
        if k % steps == 0:
            rows.append(np.column_stack([x, yaw, v, w]))
        mu = plain
        if kind == "friction_patch":
            inside = np.linalg.norm(x - np.array(params["center"]), axis=1) < params["radius"]
            mu = np.where(inside, params["k"] * plain, plain)
        if engine == "bullet":
            force, torque = np.zeros_like(x), None
        else:
            force, torque = table_friction(heavy, x, yaw, v, w, roll, mu, run.dt)
        if push:
            force = force + push(x, v, w, mass, k * run.dt)
        run.step(force, torque)
        if seen:
            seen(x, v, w, heavy)
    return np.array(rows)


def throw(rng, rolls, avoid):
    """Bodies around the middle, apart from each other and from what is hidden, thrown inwards."""
    bodies, looks = [], [(s, m) for s in DENSITY for m in ("rubber", "metal")]
    for shape, material in (looks[i] for i in rng.permutation(6)[: rng.integers(4, 7)]):
        while True:
            x = rng.uniform(-1.9, 1.9, 2)
            if np.linalg.norm(x) > 0.5 and all(np.linalg.norm(x - b["x"]) > 0.65 for b in bodies) and avoid(x) > 0.35:
                break
        aim = rng.uniform(-0.7, 0.7, 2) - x
        mass = DENSITY[shape][material == "metal"]
        bodies.append({"x": x, "yaw": rng.uniform(-0.7, 0.7), "v": rng.uniform(0.4, 1.5) * aim / np.linalg.norm(aim),
                       "w": 0.0 if shape == "sphere" and rolls else rng.uniform(-2, 2), "rolls": shape == "sphere" and rolls,
                       "shape": shape, "material": material, "mass": mass, "inertia": MOMENT[shape] * mass * SIZE ** 2})
    return bodies


def seen_as(kind, params, true):
    """What a tracker reports of places (frame, body, [x, y, yaw, ...])."""
    seen = true[..., :3].copy()
    if kind == "wrong_scale":
        seen[..., :2] *= params["scale"]
    if kind == "tilted_camera":
        seen[..., :2] /= 1 - seen[..., :2] @ np.array(params["h"])[:, None]
    if kind == "off_centre_marker":
        c, s = np.cos(seen[:, 0, 2]), np.sin(seen[:, 0, 2])
        x, y = params["arm"]
        seen[:, 0, :2] += np.stack([c * x - s * y, s * x + c * y], -1)
    return seen


def write(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def group(folder, engine, kind, strength, seed, noise, lost):
    number = [seed, list(ENGINES).index(engine), sum(map(ord, kind))]
    rng = np.random.default_rng(number)
    law = laws(rng, strength)[kind]
    params, air = law[0], rng.random() < 0.25
    world = {"mu": {"rubber": 0.002 if air else rng.uniform(0.03, 0.045), "metal": 0.001 if air else rng.uniform(0.009, 0.02)},
             "restitution": rng.uniform(0.6, 0.9), "sphere_motion": "roll" if rng.random() < 0.5 else "glide"}

    if kind == "contact_friction" and engine == "bullet":
        world["mu"] = dict.fromkeys(world["mu"], world["mu"]["metal"])

    def avoid(x):
        if kind == "hidden_wall":
            return (x - np.array(params["point"])) @ np.array(params["normal"])
        return np.linalg.norm(x - np.array(params["center"])) - params["radius"] if kind == "hidden_object" else 9.0

    hidden = [] if kind == "none" else [{"kind": kind, "params": params}]
    for index in range(4):
        bodies = throw(rng, world["sphere_motion"] == "roll", avoid)
        if kind == "off_centre_marker":
            bodies.sort(key=lambda b: b["shape"] == "sphere")
        true = simulate(engine, bodies, world, kind, law)
        noisy = seen_as(kind, params, true) + rng.normal(size=true[..., :3].shape) * [noise, noise, 2 * noise]
        seen = np.random.default_rng([*number, index]).random(true.shape[:2]) >= lost
        noisy[..., 2] = (noisy[..., 2] + math.pi) % (2 * math.pi) - math.pi
        looks = ("material", "shape", "mass")
        objects = [{"object_id": k, "color": "gray", "size": SIZE, **{w: b[w] for w in looks}} for k, b in enumerate(bodies)]
        if kind == "wrong_size":
            objects[0]["size"] = SIZE / params["factor"]
        see = lambda k, p: {"object_id": k, "location": [*p[:2].round(5), SIZE], "orientation": [0, 0, round(p[2], 5)], "inside_camera_view": True}
        frames = [{"frame_id": f, "objects": [see(k, p) for k, p in enumerate(row) if seen[f, k]]} for f, row in enumerate(noisy)]
        name = f"scene_{index:02}"
        write(folder / name / "observed.json", {"scene_index": index, "video_filename": f"{name}.mp4", "fps": FPS, "world": "table",
                                                "object_property": objects, "motion_trajectory": frames, "noise_sigma": noise})
        write(folder / name / "truth.json", {"seed": number, "engine": engine, "fps": FPS, "hidden_effects": hidden, "n_observed": FRAMES,
                                             "noise_sigma": noise, "objects": objects, "trajectory": true.round(6).tolist()})
    write(folder / "group.json", {"group": folder.name, "engine": engine, "effect": kind, "strength": strength, "outside": kind in OUTSIDE,
                                  "hidden_effects": hidden, "environment": world})


def check():
    def one(shape, x, v, rolls=False):
        return {"x": np.array([x, 0.0]), "yaw": 0.0, "v": np.array([v, 0.0]), "w": 0.0, "rolls": rolls, "shape": shape,
                "material": "metal", "mass": 1.0, "inertia": MOMENT[shape] * SIZE ** 2}

    def energy(x, v, w, bodies):
        return sum(0.5 * b["mass"] * v[k] @ v[k] + 0.5 * b["inertia"] * w[k] ** 2 for k, b in enumerate(bodies))

    for engine in ENGINES:
        world, plain, grown = {"mu": {"rubber": 0.0, "metal": 0.0}, "restitution": 0.8}, ({}, None), 0.0
        for seed in range(6):
            levels = []
            thrown = throw(np.random.default_rng(seed), False, lambda x: 9.0)
            simulate(engine, thrown, world, "none", plain, 64, lambda *state: levels.append(energy(*state)))
            # What a contact takes it may give back later: what is left at the end must be less.
            grown = max(grown, (levels[-1] if engine != "pymunk" else max(np.diff(levels) + levels[0])) / levels[0] - 1)
        print(f"{engine}: energy grows by {max(grown, 0):.1e} of the whole at most")
        for a, b in itertools.combinations_with_replacement(DENSITY, 2):
            hit = lambda v: simulate(engine, [one(a, 0.0, 0.0), one(b, -0.6, v)], world, "none", plain, 40)[-1][:, 3] @ [1, -1] / v
            print(f"  {a} and {b}: restitution {hit(0.3):.3f} at 0.3 m/s, {hit(1.2):.3f} at 1.2 m/s, 0.8 asked for")
        world["mu"]["metal"] = 0.02
        for shape, rolls in [*itertools.product(DENSITY, [False]), ("sphere", True)]:
            v = simulate(engine, [one(shape, 0.0, 0.6, rolls)], world, "none", plain, 76)[:, 0, 3]
            print(f"  {shape}, rolls: {rolls}: brakes at {(v[0] - v[25]) / G:.5f} g, then {(v[25] - v[50]) / G:.5f} g; 0.02 asked for")


def main():
    words = argparse.ArgumentParser()
    words.add_argument("folder", nargs="?", type=pathlib.Path)
    for name, default in {"engine": "mujoco,pymunk", "kinds": "library", "strength": "1.0", "seeds": "1", "noise": "0.005", "lost": "0"}.items():
        words.add_argument(f"--{name}", default=default)
    words.add_argument("--check", action="store_true")
    asked = words.parse_args()
    if asked.check or not asked.folder:
        return check()
    everything = list(laws(np.random.default_rng(0), 1.0))
    sets = {"outside": OUTSIDE, "rivals": RIVALS, "control": ["none"]}
    sets["library"] = [k for k in everything if k not in sum(sets.values(), [])]
    kinds = [kind for word in asked.kinds.split(",") for kind in sets.get(word, [word])]
    if unknown := [kind for kind in kinds if kind not in everything]:
        words.error(f"unknown kinds {unknown}; known: {', '.join([*sets, *everything])}")
    for engine, seed in itertools.product(asked.engine.split(","), map(int, asked.seeds.split(","))):
        for kind in (k for k in kinds if engine in ONLY.get(k, [engine])):
            name = f"{engine}_{kind}_{asked.strength}_{seed}"
            group(asked.folder / name, engine, kind, float(asked.strength), seed, float(asked.noise), float(asked.lost))
            print(name, flush=True)


if __name__ == "__main__":
    main()
