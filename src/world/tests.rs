//! Properties of the simulation: conservation, exact derivatives, no tunnelling, determinism.

use super::*;
use crate::effects::formula::{Formula, FormulaParameter};
use crate::effects::{EFFECTS, EffectEntry, Hook, Scalar, Scope, effect};
use crate::num::{Differential, Jet, LANES, Vec2, vec2};
use crate::scene::Shape;
use crate::world::contact::geometry::{OutlinePose, proximity};
use proptest::prelude::*;

pub(super) fn body(id: u32, shape: Shape, position: Vec2, velocity: Vec2) -> BodySpec {
    let state = State { position, velocity, ..State::default() };
    BodySpec { id, material: "m".into(), shape, mass: 1.0, start: Start { time: 0.0, state, rolling: false } }
}

/// A model with these effects: name, parameter values in the spec's order.
pub(super) fn model(bodies: Vec<BodySpec>, effects: &[(&str, &[f64])]) -> Model {
    let active = effects.iter().map(|(name, values)| {
        let mut active = ActiveEffect::new(&effect(name).expect(name).spec, &bodies);
        for (p, v) in active.parameters.iter_mut().zip(*values) {
            *p = Parameter::new(&p.name.clone(), Scope::Setup, Prior { mean: *v, sd: 0.0 }, &bodies);
        }
        active
    });
    let (effects, preset, walls, corrections) = (active.collect(), "test".into(), vec![], vec![]);
    Model { preset, bodies, walls, effects, mass_sd: 0.5, spin_sd: 0.0, corrections, impulses: vec![] }
}

pub(super) fn seconds(n: usize) -> Vec<f64> {
    (0..=n).map(|f| f as f64 * 0.04).collect()
}

/// A ball that meets the wall x = 1 after a while; spins as speeds of its surface (m/s).
fn shot(velocity: Vec2, roll: Vec2, side: f64, cushion: [f64; 4]) -> Model {
    let radius = 0.03;
    let mut ball = body(0, Shape::Ball { radius }, vec2(0.5, 0.0), velocity);
    ball.start.state.roll = roll.scaled(1.0 / radius);
    ball.start.state.spin = side / radius;
    let laws: [(&str, &[f64]); 4] = [
        ("sliding_friction", &[0.2]),
        ("rolling_resistance", &[0.01]),
        ("spin_friction", &[0.012]),
        ("cushion", &cushion),
    ];
    let mut m = model(vec![ball], &laws);
    m.walls.push(Wall { name: "right".into(), from: vec2(1.0, -9.0), to: vec2(1.0, 9.0) });
    m
}

pub(super) fn shape(kind: u8) -> Shape {
    match kind % 4 {
        0 => Shape::Disc { radius: 0.2 },
        1 => Shape::Ball { radius: 0.2 },
        2 => Shape::Square { half_side: 0.2 },
        _ => Shape::Rectangle { half_length: 0.25, half_width: 0.15 },
    }
}

/// Bodies on a grid with random velocities.
pub(super) fn crowd(seed: &[(u8, f64, f64, f64, f64, f64)]) -> Vec<BodySpec> {
    let throw = |(i, &(kind, vx, vy, spin, yaw, mass)): (usize, &(u8, f64, f64, f64, f64, f64))| {
        let mut b =
            body(i as u32, shape(kind), vec2((i % 3) as f64 * 0.9, (i / 3) as f64 * 0.9), vec2(vx, vy));
        b.start.state.spin = if b.shape.is_ball() { 0.0 } else { spin };
        b.start.state.yaw = yaw;
        b.mass = mass;
        b
    };
    seed.iter().enumerate().map(throw).collect()
}

pub(super) fn throws() -> impl Strategy<Value = Vec<(u8, f64, f64, f64, f64, f64)>> {
    let one = (0u8..4, -2.0..2.0f64, -2.0..2.0f64, -2.0..2.0f64, -1.5..1.5f64, 0.4..2.5f64);
    prop::collection::vec(one, 2..7)
}

pub(super) fn momentum(t: &Trace, m: &Model, frame: usize) -> (Vec2, f64) {
    let (mut p, mut l) = (vec2(0.0, 0.0), 0.0);
    for (s, b) in t.states[frame].iter().zip(&m.bodies) {
        let s = s.expect("present");
        p += s.velocity.scaled(b.mass);
        l += b.mass * (s.position.cross(s.velocity) + b.shape.unit_inertia() * s.spin);
    }
    (p, l)
}

pub(super) fn conserves(m: &Model, tolerance: f64) -> Result<(), TestCaseError> {
    let t = trace(m, &seconds(60));
    let ((p0, l0), e0) = (momentum(&t, m, 0), t.energy[0]);
    for f in 0..t.times.len() {
        let (p, l) = momentum(&t, m, f);
        prop_assert!((p - p0).norm() < 1e-10, "{p:?} {p0:?}");
        prop_assert!((l - l0).abs() < tolerance * (1.0 + l0.abs()), "{l} {l0}");
        let before = if f == 0 { e0 } else { t.energy[f - 1] };
        prop_assert!(t.energy[f] <= before + tolerance * e0, "{before} {}", t.energy[f]);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn elastic_impacts_conserve_momentum_and_energy(seed in throws()) {
        let m = model(crowd(&seed), &[("restitution", &[1.0, 1.0])]);
        conserves(&m, 1e-10)?;
        let t = trace(&m, &seconds(60));
        prop_assert!((t.energy[60] / t.energy[0] - 1.0).abs() < 1e-9);
    }

    /// Persistent contacts are integrated in steps, so they conserve these to the accuracy of a step.
    #[test]
    fn contacts_add_no_energy(seed in throws(), e in 0.0..1.0f64, mu in 0.0..0.5f64, reversed in -1.0..1.0f64) {
        conserves(&model(crowd(&seed), &[("restitution", &[e, 1.0]), ("contact_friction", &[mu, reversed])]), 1e-3)?;
    }

    #[test]
    fn a_cushion_adds_no_energy_and_lets_nothing_through(
        speed in 1.5..4.0f64, vy in -3.0..3.0f64, rx in -4.0..4.0f64, ry in -4.0..4.0f64, side in -4.0..4.0f64,
        e in 0.0..1.0f64, mu in 0.0..0.6f64, height in 0.0..0.6f64, reversed in 0.0..1.0f64,
    ) {
        let m = shot(vec2(speed, vy), vec2(rx, ry), side, [e, mu, height, reversed]);
        let t = trace(&m, &seconds(40));
        prop_assert_eq!(t.ending, Ending::Completed);
        for f in 1..t.times.len() {
            prop_assert!(t.energy[f] <= t.energy[f - 1] * (1.0 + 1e-9), "{} {}", t.energy[f - 1], t.energy[f]);
            prop_assert!(t.states[f][0].expect("present").position.x < 0.97 + 1e-6);
        }
    }

    #[test]
    fn bodies_never_overlap(seed in throws(), mu in 0.0..0.1f64) {
        let m = model(crowd(&seed), &[("restitution", &[0.4, 1.0]), ("sliding_friction", &[mu])]);
        let t = trace(&m, &seconds(60));
        prop_assert_eq!(t.ending, Ending::Completed);
        for row in &t.states {
            for i in 0..row.len() {
                for j in 0..i {
                    let pose = |k: usize| {
                        let s = row[k].expect("present");
                        OutlinePose::new(s.position, s.yaw, &m.bodies[k].shape)
                    };
                    let near = proximity(&pose(i), &m.bodies[i].shape, &pose(j), &m.bodies[j].shape);
                    // Contact forces are solved once per segment; until the next one another corner may overlap.
                    prop_assert!(near.gap > -1e-2, "{i} {j} {}", near.gap);
                }
            }
        }
    }

    #[test]
    fn rotating_the_scene_rotates_the_result(seed in throws(), angle in -3.0..3.0f64) {
        let effects: &[(&str, &[f64])] = &[("restitution", &[0.6, 1.0]), ("sliding_friction", &[0.05]), ("contact_friction", &[0.1])];
        let m = model(crowd(&seed[..2]), effects);
        let turn = Vec2::from_angle(angle);
        let mut turned = m.clone();
        for b in &mut turned.bodies {
            let s = &mut b.start.state;
            (s.position, s.velocity, s.yaw) = (s.position.rotated(turn), s.velocity.rotated(turn), s.yaw + angle);
        }
        let (a, b) = (trace(&m, &seconds(25)), trace(&turned, &seconds(25)));
        for (x, y) in a.states[25].iter().zip(&b.states[25]) {
            let (x, y) = (x.expect("present"), y.expect("present"));
            prop_assert!((x.position.rotated(turn) - y.position).norm() < 1e-5, "{x:?} {y:?}");
        }
    }
}

/// Rounding errors of the contact forces turn it, and spin friction must not answer to their sign.
#[test]
fn a_smooth_cushion_turns_no_ball() {
    let m = shot(vec2(2.923, 2.623), vec2(-0.236, 0.333), 0.0, [0.05, 0.0, 0.0, 0.0]);
    let t = trace(&m, &seconds(40));
    for row in &t.states {
        let spin = row[0].expect("present").spin;
        assert!(spin.abs() < 1e-6, "{spin}");
    }
}

#[test]
fn two_equal_elastic_balls_exchange_their_velocities_and_derivatives() {
    let balls = vec![
        body(0, shape(1), vec2(0.0, 0.0), vec2(1.0, 0.0)),
        body(1, shape(1), vec2(1.0, 0.0), vec2(0.0, 0.0)),
    ];
    let m = model(balls, &[("restitution", &[1.0, 1.0])]);
    let mut flat: Vec<Jet> = m.flatten().into_iter().map(num_const).collect();
    flat[3] = Jet::variable(1.0, 0);
    flat[12] = Jet::variable(0.0, 1);
    let end = simulate(&m, &flat, &seconds(50), &SimulationLimits::default()).states.pop().expect("frames");
    let v: Vec<Jet> = end.iter().map(|k| k.expect("present").velocity.x).collect();
    for (k, expected) in [(0, [0.0, 1.0]), (1, [1.0, 0.0])] {
        for (lane, expected) in expected.into_iter().enumerate() {
            assert!((v[k].derivative(lane) - expected).abs() < 1e-9, "{:?}", v[k]);
        }
    }
    // Position of the second: x1 + v0 (T - (gap / v0)), so its derivative by v0 is T exactly.
    assert!((end[1].expect("present").position.x.derivative(0) - 2.0).abs() < 1e-9);
}

fn num_const(v: f64) -> Jet {
    crate::num::Real::constant(v)
}

/// Share of the derivatives of all positions at the end that agree with central differences.
pub(super) fn derivatives_agree(m: &Model, times: &[f64]) -> (usize, usize, String) {
    let base = m.flatten();
    let (mut good, mut all, mut worst) = (0, 0, String::new());
    let limits = SimulationLimits::default();
    for first in (0..base.len()).step_by(LANES) {
        let lanes = first..(first + LANES).min(base.len());
        let flat: Vec<Jet> = base
            .iter()
            .enumerate()
            .map(|(i, &v)| if lanes.contains(&i) { Jet::variable(v, i - first) } else { num_const(v) })
            .collect();
        let jet = simulate(m, &flat, times, &limits);
        for i in lanes {
            let at = |h: f64| {
                let mut flat = base.clone();
                flat[i] += h;
                simulate(m, &flat, times, &limits).states.pop().expect("frames")
            };
            let h = 1e-7;
            let (up, down) = (at(h), at(-h));
            for (k, row) in jet.states.last().expect("frames").iter().enumerate() {
                let (Some(j), Some(u), Some(d)) = (row, up[k], down[k]) else { continue };
                let numeric =
                    [u.position.x - d.position.x, u.position.y - d.position.y].map(|v| v / (2.0 * h));
                for (exact, numeric) in
                    [j.position.x, j.position.y].map(|p| p.derivative(i - first)).iter().zip(numeric)
                {
                    all += 1;
                    if (exact - numeric).abs() <= 1e-4 * (1.0 + numeric.abs()) {
                        good += 1;
                    } else {
                        worst += &format!("value {i} of body {k}: exact {exact}, numeric {numeric}\n");
                    }
                }
            }
        }
    }
    (good, all, worst)
}

#[test]
fn derivatives_agree_with_differences_through_impacts_stops_and_rolling() {
    let effects: &[(&str, &[f64])] = &[
        ("sliding_friction", &[0.05]),
        ("rolling_resistance", &[0.01]),
        ("linear_drag", &[0.03]),
        ("quadratic_drag", &[0.05]),
        ("restitution", &[0.7, 1.0]),
        ("contact_friction", &[0.1]),
    ];
    let mut bodies = vec![
        body(0, shape(1), vec2(0.0, 0.0), vec2(1.5, 0.1)),
        body(1, shape(2), vec2(1.0, 0.05), vec2(0.0, 0.0)),
        body(2, shape(0), vec2(1.8, -0.1), vec2(-0.3, 0.0)),
        body(3, shape(3), vec2(1.5, 1.0), vec2(0.1, -0.7)),
    ];
    bodies[0].start.rolling = true;
    bodies[3].start.state.spin = 0.8;
    bodies[2].mass = 1.7;
    let (good, all, worst) = derivatives_agree(&model(bodies, effects), &seconds(70));
    assert!(good as f64 >= 0.99 * all as f64, "{good} of {all}; {worst}");
}

#[test]
fn derivatives_agree_with_differences_through_a_cushion() {
    // Sliding friction and sticking friction.
    for mu in [0.05, 0.6] {
        let m = shot(vec2(2.0, 0.7), vec2(-0.3, 1.2), 0.9, [0.8, mu, 0.3, 0.4]);
        let (good, all, worst) = derivatives_agree(&m, &seconds(30));
        assert_eq!(good, all, "{worst}");
    }
}

#[test]
fn running_side_comes_off_a_cushion_faster_than_check_side() {
    let along = |side: f64| {
        let t = trace(&shot(vec2(2.0, 0.7), vec2(0.0, 2.0), side, [0.8, 0.2, 0.28, 0.0]), &seconds(12));
        t.states[12][0].expect("present").velocity.y
    };
    // At the right wall a spin to the left (positive) moves the touching point upwards, which friction opposes.
    assert!(along(-1.5) > along(0.0) && along(0.0) > along(1.5));
}

#[test]
fn a_ball_without_slip_rolls_on_with_the_derivative_by_its_roll() {
    let (m, radius) = (shot(vec2(-1.0, 0.0), vec2(0.0, -1.0), 0.0, [0.0; 4]), 0.03);
    let mut flat: Vec<Jet> = m.flatten().into_iter().map(num_const).collect();
    flat[7] = Jet::variable(-1.0 / radius, 0);
    let end = simulate(&m, &flat, &seconds(5), &SimulationLimits::default()).states.pop().expect("frames");
    let v = end[0].expect("present").velocity.x;
    // v = (5 v0 + 2 r roll) / 7 once it rolls.
    assert!((v.derivative(0) - 2.0 / 7.0 * radius).abs() < 1e-6, "{v:?}");
}

#[test]
fn spin_friction_ends_a_spin_at_the_predicted_time() {
    let t = trace(&shot(vec2(-0.5, 0.0), vec2(0.0, -0.5), 0.3, [0.0; 4]), &seconds(60));
    // r dw/dt = -5/2 mu g.
    let until = 0.3 / (2.5 * 0.012 * 9.81);
    let spin = |f: usize| t.states[f][0].expect("present").spin * 0.03;
    let half = (until / 2.0 / 0.04) as usize;
    assert!((spin(half) - 0.3 * (1.0 - half as f64 * 0.04 / until)).abs() < 1e-6, "{}", spin(half));
    assert_eq!(spin((until / 0.04) as usize + 2), 0.0);
}

#[test]
fn on_a_tilted_table_all_masses_slide_alike_and_balls_roll_with_five_sevenths() {
    let mut bodies = vec![
        body(0, shape(0), vec2(0.0, 0.0), vec2(0.1, 0.0)),
        body(1, shape(0), vec2(0.0, 3.0), vec2(0.1, 0.0)),
    ];
    bodies[1].mass = 3.0;
    let t = trace(&model(bodies, &[("tilt", &[0.0, -0.3])]), &seconds(25));
    for b in 0..2 {
        let v = t.states[25][b].expect("present").velocity;
        assert!((v - vec2(0.1, -0.3)).norm() < 1e-9, "{v:?}");
    }
    let mut ball = body(0, shape(1), vec2(0.0, 0.0), vec2(0.5, 0.0));
    ball.start.rolling = true;
    let t = trace(&model(vec![ball], &[("sliding_friction", &[0.2]), ("tilt", &[0.7, 0.0])]), &seconds(25));
    assert!((t.states[25][0].expect("present").velocity.x - 1.0).abs() < 1e-6);
}

#[test]
fn derivatives_hold_while_bodies_push_each_other() {
    // The disc behind decelerates less than the ball in front, so it keeps pushing.
    let mut bodies = vec![
        body(0, shape(0), vec2(0.0, 0.0), vec2(1.2, 0.0)),
        body(1, Shape::Ball { radius: 0.2 }, vec2(0.6, 0.01), vec2(0.2, 0.0)),
    ];
    bodies[0].mass = 2.0;
    let m = model(
        bodies,
        &[("sliding_friction", &[0.05]), ("quadratic_drag", &[0.6]), ("restitution", &[0.0, 1.0])],
    );
    let (good, all, worst) = derivatives_agree(&m, &seconds(40));
    assert!(good as f64 >= 0.95 * all as f64, "{good} of {all}; {worst}");
}

#[test]
fn a_fast_ball_does_not_pass_through_anything() {
    for target in [shape(0), shape(2)] {
        let bodies = vec![
            body(0, Shape::Ball { radius: 0.03 }, vec2(-5.0, 0.01), vec2(30.0, 0.0)),
            body(1, target, vec2(0.0, 0.0), vec2(0.0, 0.0)),
        ];
        let t = trace(&model(bodies, &[("restitution", &[0.5, 1.0])]), &seconds(20));
        assert_eq!(t.events.iter().filter(|e| e.kind == EventKind::Collision).count(), 1);
        let last = t.states[20].clone();
        assert!(last[0].expect("present").position.x < last[1].expect("present").position.x);
    }
}

#[test]
fn friction_stops_a_sliding_body_at_the_textbook_distance() {
    let m = model(vec![body(0, shape(2), vec2(0.0, 0.0), vec2(1.0, 0.0))], &[("sliding_friction", &[0.1])]);
    let t = trace(&m, &seconds(60));
    let end = t.states[60][0].expect("present");
    assert!((end.position.x - 1.0 / (2.0 * 0.1 * 9.81)).abs() < 1e-9 && end.velocity == vec2(0.0, 0.0));
    let stop = t.events.iter().find(|e| e.kind == EventKind::Stop).expect("it stops");
    assert!((stop.time - 1.0 / 0.981).abs() < 1e-9);
}

#[test]
fn a_sliding_ball_rolls_with_five_sevenths_of_its_speed() {
    let m = model(vec![body(0, shape(1), vec2(0.0, 0.0), vec2(2.0, 0.0))], &[("sliding_friction", &[0.2])]);
    let end = trace(&m, &seconds(50)).states[50][0].expect("present");
    assert!((end.velocity.x - 2.0 * 5.0 / 7.0).abs() < 1e-9, "{}", end.velocity.x);
    assert!((end.roll.y * 0.2 - end.velocity.x).abs() < 1e-9);
}

#[test]
fn the_same_model_gives_the_same_bits_and_jets_give_the_same_events() {
    let bodies = crowd(&[
        (0, 1.0, 0.3, 0.1, 0.2, 1.0),
        (1, -1.0, 0.2, 0., 0.1, 2.0),
        (2, 0.1, 0.5, 1., 0.3, 0.7),
        (3, 0.2, -1., -1., 1., 1.),
    ]);
    let m = model(
        bodies,
        &[("restitution", &[0.5, 1.0]), ("sliding_friction", &[0.04]), ("contact_friction", &[0.2])],
    );
    assert_eq!(trace(&m, &seconds(80)), trace(&m, &seconds(80)));
    let flat: Vec<Jet> = m.flatten().into_iter().map(num_const).collect();
    let jet = simulate(&m, &flat, &seconds(80), &SimulationLimits::default());
    assert_eq!(jet.events, trace(&m, &seconds(80)).events);
}

#[test]
fn the_papers_spheres_stop_at_the_distance_of_its_equation() {
    for (shape, l) in [(shape(0), 0.1), (shape(1), 0.05)] {
        let (speed, drag) = (1.2f64, 0.06);
        let laws: [(&str, &[f64]); 2] = [("gliding_friction", &[0.1, 0.05]), ("damping", &[0.0, drag])];
        let m = model(vec![body(0, shape, vec2(0.0, 0.0), vec2(speed, 0.0))], &laws);
        let t = trace(&m, &seconds(100));
        // v dv/dx = -(l g + drag v^2), integrated to v = 0.
        let reach = (1.0 + drag * speed * speed / (l * 9.81)).ln() / (2.0 * drag);
        let last = t.states[100][0].expect("present");
        assert!((last.position.x - reach).abs() < 1e-5 && last.velocity.norm() == 0.0, "{last:?} {reach}");
        assert_eq!(t.events.iter().filter(|e| e.kind == EventKind::Stop).count(), 1);
    }
}

/// Three bodies that collide, with the base laws that the effects act on.
fn meeting(extra: &EffectEntry, values: &[f64]) -> Model {
    let mut bodies = vec![
        body(0, shape(0), vec2(3.0, 2.0), vec2(-1.1, 0.05)),
        body(3, shape(2), vec2(2.2, 2.1), vec2(-0.2, -0.1)),
        body(7, shape(1), vec2(2.1, 3.0), vec2(0.1, -1.2)),
    ];
    bodies[0].start.state.spin = 0.7;
    bodies[1].start.state.spin = -0.4;
    bodies[1].mass = 1.6;
    let base: [(&str, &[f64]); 3] =
        [("sliding_friction", &[0.03]), ("restitution", &[0.7, 1.0]), ("contact_friction", &[0.1])];
    let base: Vec<(&str, &[f64])> = base.into_iter().filter(|(name, _)| *name != extra.spec.name).collect();
    let mut m = model(bodies, &base);
    let mut active = ActiveEffect::new(&extra.spec, &m.bodies);
    for (p, v) in active.parameters.iter_mut().zip(values) {
        *p = Parameter::new(&p.name.clone(), Scope::Setup, Prior { mean: *v, sd: 0.0 }, &m.bodies);
    }
    m.effects.push(active);
    m
}

/// Parameter values at which an effect acts on these bodies.
fn placed(entry: &EffectEntry, amplitude: f64) -> Vec<f64> {
    let place = |(k, q): (usize, &crate::effects::ParamSpec)| match q.name {
        _ if k < entry.amplitudes => amplitude,
        "center_x" => 1.9,
        "center_y" => 1.2,
        "offset" | "left" => 1.9,
        "right" | "top" => 9.0,
        "Omega" => 1.5,
        _ => q.default,
    };
    entry.spec.params.iter().enumerate().map(place).collect()
}

/// Positions that the camera reports at the end, and the derivatives by the numbers from `first` on.
fn ends(m: &Model, flat: &[Jet], n: usize) -> Vec<Jet> {
    let rollout = simulate_observed(m, flat, &seconds(n), &SimulationLimits::default());
    let last = rollout.states.last().expect("frames");
    last.iter().flatten().flat_map(|k| [k.position.x, k.position.y]).collect()
}

/// Largest error of a derivative. The derivative by size omits the spin of a ball about z, whose surface speed is taken as
/// given (see `Dynamics::growth`).
fn tolerance(entry: &EffectEntry) -> f64 {
    if entry.spec.name == "wrong_size" { 0.03 } else { 3e-3 }
}

/// Laws that the collisions need, and the law of walls, of which there are none.
const BASE: [&str; 3] = ["restitution", "sliding_friction", "cushion"];

#[test]
fn an_effect_at_zero_changes_no_bit() {
    let steady = |e: &EffectEntry| (f64::hooks(e).pace)(&placed(e, 0.0)).is_infinite() && !e.uses(Hook::Pair);
    for entry in EFFECTS.iter().filter(|e| !BASE.contains(&e.spec.name) && steady(e)) {
        let (m, times) = (meeting(entry, &placed(entry, 0.0)), seconds(60));
        let rolled = |m: &Model| simulate_observed(m, &m.flatten(), &times, &SimulationLimits::default());
        let with = rolled(&m);
        let without = rolled(&Model { effects: m.effects[..m.effects.len() - 1].to_vec(), ..m });
        assert_eq!(format!("{:?}", with.states), format!("{:?}", without.states), "{}", entry.spec.name);
        assert_eq!(with.events, without.events, "{}", entry.spec.name);
    }
}

/// The score test relies on this: at zero, the derivative by each amplitude equals the effect of a small amplitude.
#[test]
fn the_derivative_at_zero_is_the_effect_of_a_small_amplitude() {
    for entry in EFFECTS.iter().filter(|e| !BASE.contains(&e.spec.name)) {
        for k in 0..entry.amplitudes {
            let m = meeting(entry, &placed(entry, 0.0));
            let first = m.flat_len() - entry.spec.params.len();
            let at = |value: f64, lane: f64| {
                let mut flat: Vec<Jet> = m.flatten().into_iter().map(num_const).collect();
                flat[first + k] = num_const(value).with_derivative(0, lane);
                ends(&m, &flat, 50)
            };
            let h = 1e-6;
            let (exact, some, none) = (at(0.0, 1.0), at(h, 0.0), at(0.0, 0.0));
            for ((e, s), n) in exact.iter().zip(&some).zip(&none) {
                let difference = (s.v - n.v) / h;
                assert!(
                    (e.derivative(0) - difference).abs() <= tolerance(entry) * (1.0 + difference.abs()),
                    "{} {k}: {} {difference}",
                    entry.spec.name,
                    e.derivative(0)
                );
            }
            assert!(exact.iter().any(|e| e.derivative(0) != 0.0), "{} {k} does nothing", entry.spec.name);
        }
    }
}

#[test]
fn derivatives_hold_with_each_effect_present() {
    for entry in EFFECTS.iter().filter(|e| !BASE.contains(&e.spec.name)) {
        // Where contacts last longer than the free motion between them, derivatives are meaningless.
        let amplitude = if entry.spec.name == "soft_contact" { 0.05 } else { 0.25 };
        let amplitude = amplitude * entry.spec.params[0].max.min(1.0);
        let m = meeting(entry, &placed(entry, amplitude));
        let first = m.flat_len() - entry.spec.params.len();
        for k in 0..entry.spec.params.len() {
            let at = |value: f64, lane: f64| {
                let mut flat: Vec<Jet> = m.flatten().into_iter().map(num_const).collect();
                flat[first + k] = (flat[first + k] + value).with_derivative(0, lane);
                ends(&m, &flat, 50)
            };
            let h = 1e-6;
            let (exact, up, down) = (at(0.0, 1.0), at(h, 0.0), at(-h, 0.0));
            for ((e, u), d) in exact.iter().zip(&up).zip(&down) {
                let difference = (u.v - d.v) / (2.0 * h);
                let name = format!("{}.{}", entry.spec.name, entry.spec.params[k].name);
                assert!(
                    (e.derivative(0) - difference).abs() <= tolerance(entry) * (1.0 + difference.abs()),
                    "{name}: {} {difference}",
                    e.derivative(0)
                );
            }
        }
    }
}

#[test]
fn a_formula_moves_bodies_as_the_library_law_with_the_same_equation() {
    let disc = || vec![body(0, shape(0), vec2(0.0, 0.0), vec2(1.5, 0.4))];
    let own = |name: &str, default| FormulaParameter {
        name: name.into(),
        unit: "1/m".into(),
        default,
        min: 0.0,
        max: 5.0,
    };
    let with = |text: &str| {
        let law = Formula { text: text.into(), parameters: vec![own("k", 0.3)] };
        let mut m = model(disc(), &[("sliding_friction", &[0.02])]);
        m.effects.push(ActiveEffect::of_formula("my_drag", law, &m.bodies).expect("a formula"));
        m
    };
    let m = with("fx = -k * vx * speed\nfy = -k * vy * speed");
    let known = model(disc(), &[("sliding_friction", &[0.02]), ("quadratic_drag", &[0.3])]);
    assert_eq!(trace(&m, &seconds(50)).states, trace(&known, &seconds(50)).states);
    let (good, all, worst) = derivatives_agree(&m, &seconds(50));
    assert_eq!(good, all, "{worst}");
    let text = serde_json::to_string(&m).expect("a model is plain data");
    assert_eq!(serde_json::from_str::<Model>(&text).expect("it was written"), m);
    // From x = 1.2 on the force has no value.
    let t = trace(&with("ax = k * ln(1.2 - x)"), &seconds(50));
    assert_eq!(t.ending, Ending::FormulaUndefined);
    let reached: Vec<_> = t.states.iter().map_while(|row| row[0]).collect();
    assert!((15..50).contains(&reached.len()) && reached.iter().all(|s| s.position.x < 1.2));
}

/// A change of one object's friction leaves that of the ground to all others, also to one that is added later.
#[test]
fn scaling_a_friction_and_adding_an_object_commute() {
    let first = body(0, shape(0), vec2(0.0, 0.0), vec2(1.0, 0.0));
    let second = body(1, shape(0), vec2(2.0, 0.0), vec2(1.0, 0.0));
    let mut m = model(vec![first], &[("sliding_friction", &[0.2])]);
    // What was fitted is not the prior.
    m.effects[0].parameters[0].values[0] = 0.1;
    let (scale, add) =
        (Intervention::ScaleFriction { id: 0, factor: 0.5 }, Intervention::Add { body: second });
    let both = |changes: [&Intervention; 3]| {
        let changed = changes.iter().try_fold(m.clone(), |m, i| i.apply(&m)).expect("it applies");
        changed.effects[0].parameters[0].values.clone()
    };
    let twice = Intervention::ScaleFriction { id: 0, factor: 0.5 };
    assert_eq!(both([&scale, &add, &twice]), [0.025, 0.1]);
    assert_eq!(both([&add, &scale, &twice]), both([&scale, &twice, &add]));
}
