//! Calibrates discovery on videos of an independent engine (rapier2d): false discoveries on controls, power by kind and
//! strength, confusions, laws outside the library, and how many true numbers lie in their 95 % intervals.
//! `cargo bench --bench discovery -- --groups 20 --controls 200 [--kinds tilt,coriolis] [--strengths weak] [--first SEED]
//! [--masses unknown] [--videos 1] [--frames 150]`

#![allow(clippy::disallowed_methods)] // Made scenes need not have the same bits everywhere.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use rapier2d::prelude as rapier;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::time::Instant;
use vrdp::discover::{DiscoverOptions, Discovery, ParameterEstimate, ParameterValue, Verdict, discover};
use vrdp::num::{NINETY_FIVE, Vec2, never, vec2};
use vrdp::scene::{Object, Sample, Scene, Shape, Track, WorldKind};
use vrdp::world::{Model, Preset};

/// Number of videos in a group and of frames in a video where the command line does not say; of steps in a frame.
const VIDEOS: usize = 4;
const FRAMES: usize = 128;
const STEPS: usize = 20;
const FPS: f64 = 25.0;
/// Measurement noise (m, rad).
const SIGMA: f64 = 0.005;
const SIGMA_YAW: f64 = 0.01;
const GRAVITY: f64 = 9.81;
const SIZE: f64 = 0.2;
/// Strengths by name, relative to the medium one.
const STRENGTHS: [(&str, f64); 3] = [("weak", 0.45), ("medium", 1.0), ("strong", 2.5)];
const DISC: Shape = Shape::Disc { radius: SIZE };
const BALL: Shape = Shape::Ball { radius: SIZE };
const CUBE: Shape = Shape::Square { half_side: SIZE };
/// Appearances: material, shape and the mass (kg) that belongs to them.
const LOOKS: [(&str, Shape, f64); 6] = [
    ("rubber", BALL, 0.42),
    ("rubber", DISC, 0.6),
    ("rubber", CUBE, 0.78),
    ("metal", BALL, 1.05),
    ("metal", DISC, 1.5),
    ("metal", CUBE, 1.95),
];

/// The state of a body for the hidden laws.
struct Mover {
    mass: f64,
    x: Vec2,
    v: Vec2,
    spin: f64,
}

/// Force on body `i` at `time`; `k` is the strength, `u` is random in -1..1 and is the group's.
type Law = fn(k: f64, u: &[f64; 4], time: f64, all: &[Mover], i: usize) -> Vec2;

fn direction(u: &[f64; 4]) -> Vec2 {
    vec2((u[0] * 0.5 * TAU).cos(), (u[0] * 0.5 * TAU).sin())
}

fn center(u: &[f64; 4]) -> Vec2 {
    vec2(u[1], u[2])
}

fn pull(d: Vec2) -> Vec2 {
    d.scaled((d.norm_squared() + 0.09).powf(-1.5))
}

fn pairs(all: &[Mover], i: usize) -> Vec2 {
    let others = (0..all.len()).filter(|j| *j != i);
    others.fold(Vec2::zero(), |sum, j| sum + pull(all[j].x - all[i].x))
}

/// Kinds as reports name them, laws of force.
const FORCES: [(&str, Law); 17] = [
    ("linear_drag", |k, _, _, all, i| all[i].v.scaled(-0.2 * k)),
    ("quadratic_drag", |k, _, _, all, i| all[i].v.scaled(-0.25 * k * all[i].v.norm())),
    ("uniform_force", |k, u, _, _, _| direction(u).scaled(0.08 * k)),
    ("tilt", |k, u, _, all, i| direction(u).scaled(0.08 * k * all[i].mass)),
    ("attractor", |k, u, _, all, i| (center(u) - all[i].x).scaled(0.08 * k)),
    ("attractor", |k, u, _, all, i| pull(center(u) - all[i].x).scaled(0.15 * k)),
    ("vortex", |k, u, _, all, i| {
        ((all[i].x - center(u)).perp().scaled(0.6 * u[3].signum()) - all[i].v).scaled(0.15 * k)
    }),
    ("coriolis", |k, u, _, all, i| all[i].v.perp().scaled(-0.16 * k * all[i].mass * u[3].signum())),
    ("lateral", |k, u, _, all, i| all[i].v.perp().scaled(0.15 * k * u[3].signum())),
    ("magnus", |k, _, _, all, i| all[i].v.perp().scaled(0.15 * k * all[i].spin)),
    ("pair_attraction", |k, _, _, all, i| pairs(all, i).scaled(0.12 * k)),
    ("pair_repulsion", |k, _, _, all, i| pairs(all, i).scaled(-0.12 * k)),
    ("time_periodic", |k, u, t, all, i| {
        direction(u).scaled(0.3 * k * all[i].mass * (TAU * (0.8 + 0.4 * u[1]) * t + 3.0 * u[2]).cos())
    }),
    // Not in the library.
    ("outside: quartic drag", |k, _, _, all, i| {
        all[i].v.scaled(-0.4 * k * all[i].v.norm_squared() * all[i].v.norm())
    }),
    ("outside: saddle", |k, _, _, all, i| vec2(all[i].x.x, -all[i].x.y).scaled(0.12 * k)),
    ("outside: shear wind", |k, _, _, all, i| vec2(0.12 * k * all[i].x.y, 0.0)),
    ("none", |_, _, _, _, _| Vec2::zero()),
];

/// More laws outside the library: forces and drags that change along one direction, and the pull of an extended mass.
const OF_PLACE: [(&str, Law); 5] = [
    ("outside: swell", |k, _, _, all, i| vec2(0.1 * k * (3.0 * all[i].x.x).sin(), 0.0)),
    ("outside: ridge", |k, _, _, all, i| vec2(0.0, 0.1 * k * all[i].x.y.abs())),
    ("outside: hollow", |k, _, _, all, i| vec2(0.05 * k * all[i].x.x * all[i].x.x, 0.0)),
    ("outside: drag off a line", |k, _, _, all, i| all[i].v.scaled(-0.3 * k * all[i].x.x.abs())),
    ("outside: spread pull", |k, u, _, all, i| {
        let d = center(u) - all[i].x;
        d.scaled(0.2 * k / (d.norm_squared() + 0.04))
    }),
];

/// Kinds that are not force laws.
const OTHERS: [&str; 6] = [
    "friction_patch",
    "hidden_wall",
    "hidden_object",
    "contact_friction",
    "speed_dependent_restitution",
    "mass_change",
];

/// Restitution that decreases with the approach speed.
struct RestitutionDecay {
    restitution: f32,
    inverse_v0: f32,
}

impl rapier::PhysicsHooks for RestitutionDecay {
    fn modify_solver_contacts(&self, context: &mut rapier::ContactModificationContext) {
        let velocity = |body: Option<rapier::RigidBodyHandle>| {
            body.and_then(|b| context.bodies.get(b)).map_or(rapier::Vector::ZERO, |b| b.linvel())
        };
        let slip = velocity(context.rigid_body2) - velocity(context.rigid_body1);
        let Some(manifold) = context.rigid_mut() else { return };
        let approach = (slip.x * manifold.normal.x + slip.y * manifold.normal.y).abs();
        *manifold.restitution = self.restitution * (-approach * self.inverse_v0).exp();
    }
}

/// Velocity and spin after ground friction that removes at most `most` (m/s) of a velocity. It acts at the corners of a box
/// and the rim of a disc; a ball slides, and spins freely about the vertical.
fn braked(shape: Shape, v: Vec2, yaw: f64, spin: f64, most: f64) -> (Vec2, f64) {
    let (points, radius, gyration) = match shape {
        Shape::Ball { .. } => (1, 0.0, 1.0),
        // Squares of the radii of gyration: r^2/2, and a^2 2/3 for a square of half side a.
        Shape::Disc { radius } => (24, radius, 0.5 * radius * radius),
        _ => (4, SIZE * 2.0f64.sqrt(), SIZE * SIZE * 2.0 / 3.0),
    };
    let (mut after, mut turned) = (v, spin);
    for k in 0..points {
        let angle = yaw + TAU * (k as f64 + 0.5) / points as f64;
        let arm = vec2(angle.cos(), angle.sin()).scaled(radius);
        let slip = v + arm.perp().scaled(spin);
        // Friction stops a small slip but never reverses it.
        let share = most.min(slip.norm() / (1.0 + radius * radius / gyration)) / points as f64;
        let impulse = slip.unit().scaled(-share);
        after += impulse;
        turned += arm.cross(impulse) / gyration;
    }
    (after, turned)
}

struct Random(ChaCha8Rng);

impl Random {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        Uniform::new(low, high).expect("low is below high").sample(&mut self.0)
    }
    fn noise(&mut self, sd: f64) -> f64 {
        let z: f64 = StandardNormal.sample(&mut self.0);
        sd * z
    }
}

/// Standard deviations from which a number is printed.
const FAR: f64 = 3.0;

/// What all videos of a group share.
struct Setup {
    kind: &'static str,
    law: Law,
    /// Strength of effects that are not force laws, such as a friction patch.
    strength: f64,
    u: [f64; 4],
    mu: BTreeMap<&'static str, f64>,
    restitution: f64,
    /// Number of frames in each video.
    frames: usize,
}

impl Setup {
    fn is(&self, kind: &str) -> bool {
        self.kind == kind
    }
    /// Whether an object may start here.
    fn is_free(&self, x: Vec2) -> bool {
        match self.kind {
            "hidden_wall" => x.dot(direction(&self.u)) > -0.7,
            "hidden_object" => (x - center(&self.u).scaled(0.5)).norm() > 0.7,
            _ => true,
        }
    }
}

fn vector(v: Vec2) -> rapier::Vector {
    rapier::Vector::new(v.x as f32, v.y as f32)
}

fn plain(v: rapier::Vector) -> Vec2 {
    vec2(v.x as f64, v.y as f64)
}

/// The moving bodies of a video: handles, masses (kg) and ground friction coefficients.
struct Movers {
    bodies: Vec<rapier::RigidBodyHandle>,
    masses: Vec<f64>,
    mus: Vec<f64>,
}

/// A collider of this shape with the material of the set-up.
fn collider(setup: &Setup, shape: Shape) -> rapier::ColliderBuilder {
    let collider = match shape {
        Shape::Square { half_side: a } => rapier::ColliderBuilder::cuboid(a as f32, a as f32),
        _ => rapier::ColliderBuilder::ball(shape.bounding_radius() as f32),
    };
    let mu = if setup.is("contact_friction") { 0.25 * setup.strength } else { 0.0 };
    let hooked = setup.is("speed_dependent_restitution");
    let hooks = if hooked { rapier::ActiveHooks::all() } else { rapier::ActiveHooks::empty() };
    collider.restitution(setup.restitution as f32).friction(mu as f32).active_hooks(hooks)
}

/// Adds the hidden wall or the hidden object, if the set-up has one.
fn add_hidden_body(setup: &Setup, world: &mut rapier::PhysicsWorld) {
    match setup.kind {
        "hidden_wall" => {
            let n = direction(&setup.u);
            let body = rapier::RigidBodyBuilder::fixed().translation(vector(n.scaled(-1.2)));
            let wall = rapier::ColliderBuilder::cuboid(0.1, 9.0).restitution(setup.restitution as f32);
            world.insert(body.rotation(n.y.atan2(n.x) as f32), wall.friction(0.0));
        }
        "hidden_object" => {
            let body = rapier::RigidBodyBuilder::fixed().translation(vector(center(&setup.u).scaled(0.5)));
            world.insert(body, collider(setup, Shape::Disc { radius: 0.25 }));
        }
        _ => {}
    }
}

/// Adds objects at random positions with random velocities, to the world and to the scene.
fn add_objects(
    setup: &Setup,
    world: &mut rapier::PhysicsWorld,
    scene: &mut Scene,
    random: &mut Random,
) -> Movers {
    // Contact laws and pair forces need several objects.
    let least = if OTHERS[3..].contains(&setup.kind) || setup.kind.starts_with("pair") { 3 } else { 1 };
    // A plane simulation lacks the rolling of a ball, so its contact friction would be wrong.
    let looks = |look: &usize| !setup.is("contact_friction") || LOOKS[*look].1 != BALL;
    let mut looks: Vec<usize> = (0..LOOKS.len()).filter(looks).collect();
    let count = (random.between(least as f64, 6.0) as usize).clamp(1, looks.len().min(5));
    scene.tracks = vec![Track::default(); count];
    let mut movers = Movers { bodies: vec![], masses: vec![], mus: vec![] };
    let mut places: Vec<Vec2> = vec![];
    while movers.bodies.len() < count {
        let x = vec2(random.between(-2.0, 2.0), random.between(-2.0, 2.0));
        if !setup.is_free(x) || places.iter().any(|p| (x - *p).norm() < 0.75) {
            continue;
        }
        places.push(x);
        let at = random.between(0.0, looks.len() as f64) as usize;
        let (name, shape, stated_mass) = LOOKS[looks.swap_remove(at.min(looks.len() - 1))];
        let id = movers.bodies.len();
        let is_changed = setup.is("mass_change") && id == 0;
        let mass = if is_changed { stated_mass * (1.0 + setup.strength) } else { stated_mass };
        let target = vec2(random.between(-0.7, 0.7), random.between(-0.7, 0.7));
        let v = (target - x).unit().scaled(random.between(0.4, 1.6));
        let most = if setup.is("magnus") { 6.0 } else { 1.0 };
        let spin = if shape == BALL { 0.0 } else { random.between(-most, most) };
        let rigid = rapier::RigidBodyBuilder::dynamic().translation(vector(x)).linvel(vector(v));
        let rigid = rigid.angvel(spin as f32).rotation(random.between(-3.0, 3.0) as f32).can_sleep(false);
        movers.bodies.push(world.insert(rigid, collider(setup, shape).mass(mass as f32)).0);
        movers.masses.push(mass);
        movers.mus.push(setup.mu[name]);
        let (color, material) = ("gray".into(), name.into());
        scene.objects.push(Object {
            id: id as u32,
            color,
            material,
            shape,
            mass: Some(stated_mass),
            features: vec![],
        });
    }
    movers
}

/// Applies the hidden law and ground friction for a step of `dt` (s), which starts at `time` (s).
fn push(
    setup: &Setup,
    world: &mut rapier::PhysicsWorld,
    scene: &Scene,
    movers: &Movers,
    [time, dt]: [f64; 2],
) {
    let mover = |(body, mass): (&rapier::RigidBodyHandle, &f64)| {
        let b = &world.bodies[*body];
        let (x, v) = (plain(b.translation()), plain(b.linvel()));
        Mover { mass: *mass, x, v, spin: b.angvel() as f64 }
    };
    let all: Vec<Mover> = movers.bodies.iter().zip(&movers.masses).map(mover).collect();
    for (i, body) in movers.bodies.iter().enumerate() {
        let force = (setup.law)(setup.strength, &setup.u, time, &all, i);
        let pushed = all[i].v + force.scaled(dt / all[i].mass);
        let rough = setup.is("friction_patch") && (all[i].x - center(&setup.u).scaled(0.6)).norm() < 0.8;
        let mu = movers.mus[i] * if rough { 1.0 + 2.0 * setup.strength } else { 1.0 };
        let b = &mut world.bodies[*body];
        let yaw = b.rotation().angle() as f64;
        let (v, spin) = braked(scene.objects[i].shape, pushed, yaw, all[i].spin, mu * GRAVITY * dt);
        b.set_linvel(vector(v), true);
        b.set_angvel(spin as f32, true);
    }
}

fn video(setup: &Setup, number: usize, random: &mut Random) -> Scene {
    let mut world = rapier::PhysicsWorld { gravity: rapier::Vector::ZERO, ..Default::default() };
    let dt = 1.0 / (FPS * STEPS as f64);
    world.integration_parameters.dt = dt as f32;
    add_hidden_body(setup, &mut world);
    let mut scene = Scene {
        name: format!("video {number}"),
        setup: None,
        world: WorldKind::Table,
        fps: FPS,
        times: (0..setup.frames).map(|f| f as f64 / FPS).collect(),
        camera: None,
        table: None,
        noise_sigma: Some(SIGMA),
        tracks: vec![],
        outliers: vec![],
        findings: vec![],
        feature_layout: None,
        absent: vec![],
        objects: vec![],
    };
    let movers = add_objects(setup, &mut world, &mut scene, random);
    let decay = if setup.is("speed_dependent_restitution") { 0.7 * setup.strength } else { 0.0 };
    let hooks = RestitutionDecay { restitution: setup.restitution as f32, inverse_v0: decay as f32 };
    for frame in 0..setup.frames {
        for (track, body) in scene.tracks.iter_mut().zip(&movers.bodies) {
            let b = &world.bodies[*body];
            let position = plain(b.translation()) + vec2(random.noise(SIGMA), random.noise(SIGMA));
            let yaw = Some(b.rotation().angle() as f64 + random.noise(SIGMA_YAW));
            track.samples.push(Sample { frame, position, yaw, covariance: None });
        }
        for step in 0..STEPS {
            let time = (frame * STEPS + step) as f64 * dt;
            push(setup, &mut world, &scene, &movers, [time, dt]);
            world.step_with_events(&hooks, &());
        }
    }
    scene
}

/// Number of videos in a group, and of frames in a video.
#[derive(Clone, Copy)]
struct Length {
    videos: usize,
    frames: usize,
}

fn group(kind: &'static str, law: Law, strength: f64, seed: u64, length: Length) -> (Setup, Vec<Scene>) {
    let mut random = Random(ChaCha8Rng::seed_from_u64(seed));
    let u = [0; 4].map(|_| random.between(-1.0, 1.0));
    let mu =
        BTreeMap::from([("rubber", random.between(0.03, 0.045)), ("metal", random.between(0.009, 0.021))]);
    let restitution = random.between(0.6, 0.9);
    let strength = strength * random.between(0.8, 1.25);
    let setup = Setup { kind, law, strength, u, mu, restitution, frames: length.frames };
    let scenes = (0..length.videos).map(|number| video(&setup, number, &mut random)).collect();
    (setup, scenes)
}

/// True values of the reported quantities of the set-up's effect, as far as they are numbers.
fn truth(setup: &Setup, effect: &str) -> Vec<(&'static str, Vec<f64>)> {
    let (k, u) = (setup.strength, &setup.u);
    let vector = |v: Vec2| vec![v.x, v.y];
    let eps = ("eps", vec![0.3]);
    match setup.kind {
        "linear_drag" => vec![("c", vec![0.2 * k])],
        "quadratic_drag" => vec![("c", vec![0.25 * k])],
        "uniform_force" => vec![("F", vector(direction(u).scaled(0.08 * k)))],
        "tilt" => vec![("a", vector(direction(u).scaled(0.08 * k)))],
        "attractor" if effect == "attractor_spring" => {
            vec![("k", vec![0.08 * k]), ("center", vector(center(u)))]
        }
        "attractor" => vec![("S", vec![0.15 * k]), ("center", vector(center(u))), eps],
        "vortex" => {
            vec![("c", vec![0.15 * k]), ("center", vector(center(u))), ("Omega", vec![0.6 * u[3].signum()])]
        }
        "coriolis" => vec![("Omega", vec![0.08 * k * u[3].signum()])],
        "lateral" => vec![("b", vec![0.15 * k * u[3].signum()])],
        "magnus" => vec![("S", vec![0.15 * k])],
        "pair_attraction" | "pair_repulsion" => vec![("S", vec![0.12 * k]), eps],
        "time_periodic" => vec![("a", vec![0.3 * k]), ("f", vec![0.8 + 0.4 * u[1]])],
        "friction_patch" => {
            vec![("center", vector(center(u).scaled(0.6))), ("radius", vec![0.8]), ("k", vec![1.0 + 2.0 * k])]
        }
        "speed_dependent_restitution" => vec![("v0", vec![1.0 / (0.7 * k)])],
        "mass_change" => vec![("factor", vec![1.0 + k])],
        _ => vec![],
    }
}

fn components(value: &ParameterValue) -> Vec<f64> {
    match value {
        ParameterValue::Number(v) => vec![*v],
        ParameterValue::Vector(v) => v.to_vec(),
        ParameterValue::Word(_) => vec![],
    }
}

/// A reported number, its 95 % interval, and the true value.
struct NumberTrial {
    name: String,
    truth: f64,
    low: f64,
    high: f64,
}

impl NumberTrial {
    fn is_inside(&self) -> bool {
        (self.low..=self.high).contains(&self.truth)
    }

    /// Distance from the middle of the interval in standard deviations.
    fn off(&self) -> f64 {
        (self.truth - 0.5 * (self.low + self.high)) / ((self.high - self.low) / (2.0 * NINETY_FIVE))
    }
}

/// The numbers of the found effect, and the friction coefficients of the base, with their true values.
fn number_trials(setup: &Setup, d: &Discovery) -> Vec<NumberTrial> {
    let mut trials = vec![];
    for effect in d.effects.iter().filter(|e| setup.is(&e.kind)) {
        let of_owner = |p: &&ParameterEstimate| p.owner.is_none_or(|o| o.object == 0);
        for (name, values) in truth(setup, &effect.effect) {
            for p in effect.parameters.iter().filter(of_owner).filter(|p| p.name == name) {
                let bounds = components(&p.low).into_iter().zip(components(&p.high));
                trials.extend(values.iter().zip(bounds).map(|(&truth, (low, high))| NumberTrial {
                    name: format!("{}.{name}", effect.effect),
                    truth,
                    low,
                    high,
                }));
            }
        }
    }
    let posterior = d.revisions.last().map(|r| &r.fit.posterior);
    for e in posterior.iter().flat_map(|p| &p.estimates).filter(|e| e.identified) {
        let known = setup
            .mu
            .iter()
            .find(|(look, _)| e.name.starts_with("gliding_friction.sliding") && e.name.contains(*look));
        trials.extend(known.map(|(_, &truth)| NumberTrial {
            name: format!(
                "friction coefficient {}",
                if d.verdict == Verdict::OutsideLibrary { "of a wrong model" } else { "" }
            ),
            truth,
            low: e.value - NINETY_FIVE * e.sd,
            high: e.value + NINETY_FIVE * e.sd,
        }));
    }
    trials
}

/// The verdict as one word.
fn answer(kind: &str, d: &Discovery) -> String {
    let outside = kind.starts_with("outside");
    match d.verdict {
        Verdict::EffectFound => d.effects.iter().map(|e| e.kind.as_str()).collect::<Vec<_>>().join("+"),
        Verdict::Ambiguous if d.ambiguous.iter().flatten().any(|k| k == kind) => kind.to_string(),
        Verdict::Ambiguous => "ambiguous".into(),
        Verdict::OutsideLibrary if outside && d.formula.is_some() => kind.to_string(),
        Verdict::OutsideLibrary => "outside".into(),
        Verdict::Adequate => "none".into(),
        Verdict::NotIdentifiable => "not identifiable".into(),
    }
}

/// One group of the calibration and its verdict.
struct CalibrationTrial {
    kind: &'static str,
    strength: &'static str,
    verdict: String,
    /// Whether the verdict is that one effect, or more, were found.
    found: bool,
    numbers: Vec<NumberTrial>,
    /// s.
    time: f64,
}

fn trial(
    kind: &'static str,
    law: Law,
    strength: (&'static str, f64),
    seed: u64,
    (masses_known, length): (bool, Length),
) -> CalibrationTrial {
    let (setup, mut scenes) = group(kind, law, strength.1, seed, length);
    if !masses_known {
        scenes.iter_mut().flat_map(|s| &mut s.objects).for_each(|o| o.mass = None);
    }
    let models: Vec<Model> = scenes.iter().map(|s| Preset::for_world(s.world).model(s)).collect();
    let start = Instant::now();
    let outcome = discover(&scenes, &models, &DiscoverOptions::default(), &never);
    let time = start.elapsed().as_secs_f64();
    let (verdict, reason) = match &outcome {
        Ok(d) => (answer(kind, d), format!("{} {}", d.reason, d.formula.as_deref().unwrap_or_default())),
        Err(e) => (e.to_string(), String::new()),
    };
    let found = outcome.as_ref().is_ok_and(|d| d.verdict == Verdict::EffectFound);
    let right = verdict == kind || kind == "none";
    let numbers: Vec<NumberTrial> =
        outcome.iter().filter(|_| right).flat_map(|d| number_trials(&setup, d)).collect();
    let ambiguous = outcome.iter().flat_map(|d| &d.ambiguous).map(|kinds| kinds.join("|"));
    let ambiguous = ambiguous.collect::<Vec<_>>().join(" ");
    eprintln!("{kind} {} {seed}: {verdict} ({time:.1} s) {ambiguous} {reason}", strength.0);
    for n in numbers.iter().filter(|n| n.off().abs() > FAR) {
        eprintln!("  {}: [{}, {}], truly {}", n.name, n.low, n.high, n.truth);
    }
    CalibrationTrial { kind, strength: strength.0, verdict, found, numbers, time }
}

/// Prints how many numbers lie in their intervals, and the root mean square of their distances in standard deviations.
fn print_coverage(trials: &[CalibrationTrial]) {
    let mut by_name: BTreeMap<&str, Vec<&NumberTrial>> = BTreeMap::new();
    for number in trials.iter().flat_map(|t| &t.numbers) {
        by_name.entry(&number.name).or_default().push(number);
    }
    println!("true numbers in their 95 % interval, root mean square distance in standard deviations:");
    let line = |name: &str, numbers: &[&NumberTrial]| {
        let inside = numbers.iter().filter(|n| n.is_inside()).count();
        let rms = (numbers.iter().map(|n| n.off().powi(2)).sum::<f64>() / numbers.len().max(1) as f64).sqrt();
        println!("  {name:36} {inside:4}/{:4} {rms:6.2}", numbers.len());
    };
    by_name.iter().for_each(|(name, numbers)| line(name, numbers));
    line("all", &by_name.values().flatten().copied().collect::<Vec<_>>());
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let after = |name: &str| arguments.iter().position(|a| a == name).and_then(|at| arguments.get(at + 1));
    let number = |name: &str, default: u64| after(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    let (groups, controls, first) = (number("--groups", 1), number("--controls", 4), number("--first", 0));
    let named = |list: &str, name: &str| {
        after(list).is_none_or(|list| list.split(',').any(|wanted| name.contains(wanted)))
    };
    let masses_known = after("--masses").is_none_or(|masses| masses != "unknown");
    let length = Length {
        videos: number("--videos", VIDEOS as u64) as usize,
        frames: number("--frames", FRAMES as u64) as usize,
    };
    let none: Law = |_, _, _, _, _| Vec2::zero();
    // The seed depends on the position in this list: append new kinds at the end.
    let all = FORCES.into_iter().chain(OTHERS.map(|kind| (kind, none))).chain(OF_PLACE);
    let mut wanted = vec![];
    for (which, (kind, law)) in all.enumerate().filter(|(_, (kind, _))| named("--kinds", kind)) {
        let control = kind == "none";
        let strengths = if control { &STRENGTHS[1..2] } else { &STRENGTHS[..] };
        for &strength in strengths.iter().filter(|s| control || named("--strengths", s.0)) {
            let seeds = first..first + if control { controls } else { groups };
            wanted.extend(seeds.map(|seed| (kind, law, strength, seed * 1000 + 10 * which as u64)));
        }
    }
    let trials: Vec<CalibrationTrial> =
        wanted.into_par_iter().map(|(k, l, s, seed)| trial(k, l, s, seed, (masses_known, length))).collect();
    let mut right: BTreeMap<(&str, &str), (u64, u64)> = BTreeMap::new();
    let mut confused: BTreeMap<(&str, &str, &str), u64> = BTreeMap::new();
    for t in &trials {
        let count = right.entry((t.kind, t.strength)).or_default();
        count.0 += u64::from(t.verdict == t.kind);
        count.1 += 1;
        if t.verdict != t.kind {
            *confused.entry((t.kind, t.strength, &t.verdict)).or_default() += 1;
        }
    }
    println!("right of all, by kind and strength:");
    for ((kind, strength), (right, all)) in &right {
        println!("  {kind:28} {strength:7} {right}/{all}");
    }
    println!("taken for something else:");
    for ((kind, strength, verdict), count) in &confused {
        println!("  {kind:28} {strength:7} {verdict:40} {count}");
    }
    let wrong = trials.iter().filter(|t| t.found && t.verdict != t.kind).count();
    println!("effect found, but another: {wrong} of {}", trials.len());
    print_coverage(&trials);
    let slowest = trials.iter().map(|t| t.time).fold(0.0, f64::max);
    let mean = trials.iter().map(|t| t.time).sum::<f64>() / trials.len().max(1) as f64;
    println!("a group: {mean:.1} s, the slowest {slowest:.1} s (groups share the cores)");
}
