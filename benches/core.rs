//! What the work of a request costs: one rollout (beside rapier2d's), one Jacobian pass, one fit, one question.

use criterion::{Criterion, criterion_group, criterion_main};
use rapier2d::prelude as rapier;
use std::hint::black_box;
use vrdp::fit::{Fit, FitOptions, fit};
use vrdp::num::{Jet, LANES, never};
use vrdp::reason::{AskOptions, Question, ask};
use vrdp::scene::{Scene, Shape, parse};
use vrdp::world::{Limits, Model, Preset, simulate, trace};

const SCENE: &str = include_str!("../tests/data/clevrer/scene_00000/observed.json");
const LIMITS: Limits = Limits { events: 100_000 };

struct Fitted {
    scene: Scene,
    start: Model,
    fit: Fit,
    times: Vec<f64>,
}

fn fitted() -> Fitted {
    let scene = parse("scene_00000", SCENE).expect("the committed scene is valid");
    let start = Preset::for_world(scene.world).model(&scene);
    let fit = fit_once(&scene, &start);
    let times = scene.times.clone();
    Fitted { scene, start, fit, times }
}

fn fit_once(scene: &Scene, start: &Model) -> Fit {
    let (scenes, starts) = (std::slice::from_ref(scene), std::slice::from_ref(start));
    fit(scenes, starts, &FitOptions::default(), &never).expect("the committed scene can be fitted")
}

fn benches(criterion: &mut Criterion) {
    let fitted = fitted();
    let model = &fitted.fit.scenes[0].model;
    criterion.bench_function("rollout", |b| b.iter(|| trace(black_box(model), &fitted.times)));
    criterion
        .bench_function("rollout_rapier2d", |b| b.iter(|| rapier_rollout(black_box(model), &fitted.times)));
    criterion.bench_function("jacobian_pass", |b| {
        let flat = model.flatten();
        let jets: Vec<Jet> = flat.iter().enumerate().map(|(i, v)| Jet::variable(*v, i % LANES)).collect();
        b.iter(|| simulate(black_box(model), &jets, &fitted.times, &LIMITS));
    });
    let mut slow = criterion.benchmark_group("whole");
    slow.sample_size(10);
    slow.bench_function("fit", |b| b.iter(|| fit_once(black_box(&fitted.scene), &fitted.start)));
    slow.bench_function("question", |b| {
        let question = Question::English { question: "How many collisions happen?".into(), choices: vec![] };
        b.iter(|| {
            let options = AskOptions::default();
            ask(&fitted.scene, &fitted.fit, 0, black_box(&question), &options, &never)
        });
    });
}

/// The same bodies on the same frames; rapier knows no friction of the ground, so damping stands for it.
fn rapier_rollout(model: &Model, times: &[f64]) -> rapier::PhysicsWorld {
    let mut world = rapier::PhysicsWorld { gravity: rapier::Vector::ZERO, ..Default::default() };
    let mut waiting: Vec<_> = model.bodies.iter().collect();
    let mut before = times[0];
    for &time in times {
        waiting.retain(|body| {
            let starts = body.start.time <= time;
            if starts {
                let state = body.start.state;
                let rigid = rapier::RigidBodyBuilder::dynamic()
                    .translation(rapier::Vector::new(state.position.x as f32, state.position.y as f32))
                    .rotation(state.yaw as f32)
                    .linvel(rapier::Vector::new(state.velocity.x as f32, state.velocity.y as f32))
                    .angvel(state.spin as f32)
                    .linear_damping(0.2);
                let collider = match body.shape {
                    Shape::Disc { radius } | Shape::Ball { radius } => {
                        rapier::ColliderBuilder::ball(radius as f32)
                    }
                    Shape::Square { half_side: a } => rapier::ColliderBuilder::cuboid(a as f32, a as f32),
                    Shape::Rectangle { half_length: a, half_width: b } => {
                        rapier::ColliderBuilder::cuboid(a as f32, b as f32)
                    }
                };
                world.insert(rigid, collider.mass(body.mass as f32).restitution(0.4));
            }
            !starts
        });
        if time > before {
            world.integration_parameters.dt = (time - before) as f32;
            world.step();
        }
        before = time;
    }
    world
}

criterion_group!(all, benches);
criterion_main!(all);
