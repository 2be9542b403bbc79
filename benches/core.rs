//! Measures a simulation, a Jacobian pass, a fit and a question; and simulations of 6 to 600 objects compared with rapier2d.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rapier2d::prelude as rapier;
use std::hint::black_box;
use vrdp::effects::{Scope, effect};
use vrdp::fit::{Fit, FitOptions, estimate_one, with_draws};
use vrdp::num::{Jet, LANES, Vec2, never};
use vrdp::reason::{AskOptions, Question, ask};
use vrdp::scene::{Scene, Shape, parse};
use vrdp::world::{
    ActiveEffect, BodySpec, Model, Parameter, Preset, Prior, SimulationLimits, Start, State, simulate, trace,
};

const SCENE: &str = include_str!("../tests/data/clevrer/scene_00000/observed.json");
const LIMITS: SimulationLimits = SimulationLimits { events: 100_000 };

struct Fitted {
    scene: Scene,
    start: Model,
    fit: Fit,
    times: Vec<f64>,
}

fn fitted() -> Fitted {
    let scene = parse("scene_00000", SCENE).expect("the committed scene is valid");
    let start = Preset::for_world(scene.world).model(&scene);
    let fit = draws(&scene, fit_once(&scene, &start));
    let times = scene.times.clone();
    Fitted { scene, start, fit, times }
}

fn fit_once(scene: &Scene, start: &Model) -> Fit {
    estimate_one(scene, start, &FitOptions::default(), &never).expect("the committed scene can be fitted")
}

fn draws(scene: &Scene, fit: Fit) -> Fit {
    with_draws(std::slice::from_ref(scene), fit, &never).expect("nothing stops it")
}

fn benches(criterion: &mut Criterion) {
    let fitted = fitted();
    let model = &fitted.fit.scenes[0].model;
    criterion.bench_function("rollout", |b| b.iter(|| trace(black_box(model), &fitted.times)));
    criterion.bench_function("jacobian_pass", |b| {
        let flat = model.flatten();
        let jets: Vec<Jet> = flat.iter().enumerate().map(|(i, v)| Jet::variable(*v, i % LANES)).collect();
        b.iter(|| simulate(black_box(model), &jets, &fitted.times, &LIMITS));
    });
    rollouts(criterion);
    let mut slow = criterion.benchmark_group("whole");
    slow.sample_size(10);
    slow.bench_function("fit", |b| b.iter(|| fit_once(black_box(&fitted.scene), &fitted.start)));
    let estimated = fit_once(&fitted.scene, &fitted.start);
    slow.bench_function("draws", |b| {
        b.iter(|| draws(black_box(&fitted.scene), estimated.clone()));
    });
    slow.bench_function("question", |b| {
        let question = Question::English { question: "How many collisions happen?".into(), choices: vec![] };
        b.iter(|| {
            let options = AskOptions::default();
            ask(&fitted.scene, &fitted.fit, 0, black_box(&question), &options, &never)
        });
    });
}

/// Simulates crowds for 5.12 s, and rapier2d at its usual step for comparison; the rate counts objects.
fn rollouts(criterion: &mut Criterion) {
    let times: Vec<f64> = (0..=128).map(|frame| f64::from(frame) * 0.04).collect();
    let mut group = criterion.benchmark_group("crowd");
    group.sample_size(10);
    for objects in [6, 60, 600] {
        let model = crowd(objects);
        group.throughput(Throughput::Elements(u64::from(objects)));
        group.bench_with_input(BenchmarkId::new("vrdp", objects), &model, |b, model| {
            b.iter(|| trace(black_box(model), &times));
        });
        group.bench_with_input(BenchmarkId::new("rapier2d", objects), &model, |b, model| {
            b.iter(|| rapier_rollout(black_box(model), *times.last().expect("frames")));
        });
    }
}

/// Objects with random velocities near the points of a square grid; the density does not depend on their number.
fn crowd(objects: u32) -> Model {
    let columns = f64::from(objects).sqrt().ceil() as u32;
    let mut seed = 12_345_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
    };
    let shapes = [Shape::Disc { radius: 0.2 }, Shape::Ball { radius: 0.2 }, Shape::Square { half_side: 0.2 }];
    let body = |id: u32| {
        let place = |k: u32, off: f64| f64::from(k) * 1.2 + 0.3 * off;
        let state = State {
            position: Vec2 { x: place(id % columns, random()), y: place(id / columns, random()) },
            velocity: Vec2 { x: 3.0 * random(), y: 3.0 * random() },
            ..State::default()
        };
        let start = Start { time: 0.0, state, rolling: false };
        BodySpec { id, material: "any".into(), shape: shapes[id as usize % 3], mass: 1.0, start }
    };
    let bodies: Vec<BodySpec> = (0..objects).map(body).collect();
    let laws = [
        ("sliding_friction", 0.03),
        ("rolling_resistance", 0.01),
        ("restitution", 0.5),
        ("contact_friction", 0.1),
    ];
    let active = |(name, value): (&str, f64)| {
        let mut active = ActiveEffect::new(&effect(name).expect(name).spec, &[]);
        for (k, parameter) in active.parameters.iter_mut().enumerate() {
            // One value for all: separate values for all pairs of 600 objects would be too many.
            let prior = Prior { mean: if k == 0 { value } else { parameter.prior.mean }, sd: 0.0 };
            *parameter = Parameter::new(&parameter.name.clone(), Scope::Setup, prior, &bodies);
        }
        active
    };
    let effects = laws.map(active).into();
    Model {
        preset: "crowd".into(),
        bodies,
        walls: vec![],
        effects,
        corrections: vec![],
        impulses: vec![],
        mass_sd: 0.5,
        spin_sd: 0.0,
    }
}

/// Simulates the same bodies in rapier until `end` (s), in steps of 4 ms; damping replaces ground friction, which it lacks.
fn rapier_rollout(model: &Model, end: f64) -> rapier::PhysicsWorld {
    const STEP: f64 = 0.004;
    let mut world = rapier::PhysicsWorld { gravity: rapier::Vector::ZERO, ..Default::default() };
    for body in &model.bodies {
        let state = body.start.state;
        let rigid = rapier::RigidBodyBuilder::dynamic()
            .translation(rapier::Vector::new(state.position.x as f32, state.position.y as f32))
            .rotation(state.yaw as f32)
            .linvel(rapier::Vector::new(state.velocity.x as f32, state.velocity.y as f32))
            .angvel(state.spin as f32)
            .linear_damping(0.2);
        let collider = match body.shape {
            Shape::Disc { radius } | Shape::Ball { radius } => rapier::ColliderBuilder::ball(radius as f32),
            Shape::Square { half_side: a } => rapier::ColliderBuilder::cuboid(a as f32, a as f32),
            Shape::Rectangle { half_length: a, half_width: b } => {
                rapier::ColliderBuilder::cuboid(a as f32, b as f32)
            }
        };
        world.insert(rigid, collider.mass(body.mass as f32).restitution(0.5).friction(0.1));
    }
    world.integration_parameters.dt = STEP as f32;
    for _ in 0..(end / STEP).round() as usize {
        world.step();
    }
    world
}

criterion_group!(all, benches);
criterion_main!(all);
