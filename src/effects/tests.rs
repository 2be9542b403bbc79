//! What holds for every effect in the table, also for those nobody has written yet.

use super::*;
use crate::body::{Body, BodyCorrection, Contact, ContactLaw, Observation, ObstacleShape, Wrench};
use crate::num::{Differential, Jet, Real, Vec2, vec2};
use crate::scene::Shape;

/// Numbers of a body's state: x, y, yaw, vx, vy, spin, roll_x, roll_y, mass.
type State<T> = [T; 9];

const ONE: State<f64> = [0.4, -0.3, 0.3, 1.2, -0.5, 0.8, 0.1, 2.0, 1.3];
const OTHER: State<f64> = [0.7, 0.1, 0.1, -1.0, 0.4, -0.6, 0.2, 1.0, 0.9];
const TIME: f64 = 0.7;

fn body<T: Real>(s: &State<T>) -> Body<T> {
    let shape = Shape::Square { half_side: 0.2 };
    let [x, y, yaw, vx, vy, spin, roll_x, roll_y, mass] = *s;
    Body { shape, mass, position: vec2(x, y), yaw, velocity: vec2(vx, vy), spin, roll: vec2(roll_x, roll_y) }
}

fn constants<T: Real, const N: usize>(values: [f64; N]) -> [T; N] {
    values.map(T::constant)
}

/// Forces on bodies all over the place, on a line so dense that no edge of a patch is missed.
fn forces<T: Scalar>(entry: &EffectEntry, p: &[T], s: &State<T>) -> Vec<T> {
    let hooks = T::hooks(entry);
    let mut all = vec![];
    for step in 0..600 {
        let mut s = *s;
        s[0] = s[0] + (step as f64 - 300.0) * 0.008;
        let mut w = Wrench::zero();
        let shape =
            if step % 2 == 0 { Shape::Square { half_side: 0.2 } } else { Shape::Ball { radius: 0.2 } };
        (hooks.force)(p, T::constant(TIME), &Body { shape, ..body(&s) }, &mut w);
        let Wrench {
            force,
            torque,
            friction_limit,
            friction_arm,
            friction_skew,
            diagonal_load,
            load_concentration,
            rolling_resistance,
            rolling_torque,
            damping,
            spin_damping,
            spin_friction_limit,
            friction_excess,
        } = w;
        all.extend([
            force.x,
            force.y,
            torque,
            friction_limit,
            friction_arm,
            friction_skew,
            diagonal_load,
            load_concentration,
            rolling_resistance,
            rolling_torque,
        ]);
        all.extend([damping, spin_damping, spin_friction_limit, friction_excess]);
    }
    all
}

fn pair<T: Scalar>(entry: &EffectEntry, p: &[T], s: &State<T>) -> Vec<T> {
    let f = (T::hooks(entry).pair)(p, &body(s), &body(&constants(OTHER)));
    vec![f.x, f.y]
}

/// Laws of a contact with another body, and with a wall.
fn contact<T: Scalar>(entry: &EffectEntry, p: &[T], s: &State<T>) -> Vec<T> {
    let (a, other) = (body(s), body(&constants(OTHER)));
    let normal = vec2(T::constant(0.6), T::constant(0.8));
    let approach = normal.dot(a.velocity - other.velocity);
    let point = (a.position + other.position).scaled(0.5);
    let mut all = vec![];
    for b in [Some(other), None] {
        let mut law = ContactLaw::plain();
        (T::hooks(entry).contact)(p, p, &Contact { a, b, normal, point, approach }, &mut law);
        let ContactLaw {
            restitution,
            friction,
            restitution_decay,
            softness,
            damping,
            presence,
            contact_height,
            tangential_restitution,
            ignore_roll,
            stick,
            inverse_strength,
        } = law;
        all.extend([
            restitution,
            friction,
            restitution_decay,
            softness,
            damping,
            presence - 1.0,
            contact_height,
            tangential_restitution,
        ]);
        all.extend([ignore_roll, stick, inverse_strength]);
    }
    all
}

/// An obstacle that is absent, with its derivatives, is nothing.
fn bodies<T: Scalar>(entry: &EffectEntry, p: &[T]) -> Vec<T> {
    let found = (T::hooks(entry).bodies)(p).filter(|o| o.presence.value() != 0.0);
    let Some(o) = found else { return vec![] };
    let [x, y, z] = match o.outline {
        ObstacleShape::HalfPlane { offset, angle } => [offset, angle, T::zero()],
        ObstacleShape::Disc { center, radius } => [center.x, center.y, radius],
        ObstacleShape::Inside { x, y } => return [x, y, [o.presence, o.restitution]].concat(),
    };
    vec![x, y, z, o.presence, o.restitution]
}

fn matter<T: Scalar>(entry: &EffectEntry, p: &[T]) -> Vec<T> {
    let mut matter = BodyCorrection { mass: T::constant(1.0), size: T::constant(1.0) };
    (T::hooks(entry).matter)(p, &mut matter);
    vec![matter.mass - 1.0, matter.size - 1.0]
}

fn view<T: Scalar>(entry: &EffectEntry, p: &[T], s: &State<T>) -> Vec<T> {
    let b = body(s);
    let mut view = Observation { position: b.position, yaw: b.yaw };
    (T::hooks(entry).observe)(p, &mut view);
    vec![view.position.x - b.position.x, view.position.y - b.position.y, view.yaw - b.yaw]
}

/// Everything an effect gives, hook by hook.
fn output<T: Scalar>(entry: &EffectEntry, p: &[T], s: &State<T>) -> Vec<(Hook, Vec<T>)> {
    vec![
        (Hook::Force, forces(entry, p, s)),
        (Hook::Pair, pair(entry, p, s)),
        (Hook::Contact, contact(entry, p, s)),
        (Hook::Margin, vec![(T::hooks(entry).margin)(p)]),
        (Hook::Bodies, bodies(entry, p)),
        (Hook::Matter, matter(entry, p)),
        (Hook::Observe, view(entry, p, s)),
        (Hook::Clock, vec![(T::hooks(entry).clock)(p, TIME)]),
    ]
}

fn flat<T: Scalar>(entry: &EffectEntry, p: &[T], s: &State<T>) -> Vec<T> {
    output(entry, p, s).into_iter().flat_map(|(_, values)| values).collect()
}

fn defaults(entry: &EffectEntry) -> Vec<f64> {
    entry.spec.params.iter().map(|q| q.default).collect()
}

/// All parameters well inside their bounds and off their defaults.
fn present(entry: &EffectEntry) -> Vec<f64> {
    let off = |q: &ParamSpec| if q.default < q.max { 0.3 * (q.max - q.default).min(1.0) } else { -0.3 };
    entry.spec.params.iter().map(|q| q.default + off(q)).collect()
}

#[test]
fn names_are_unique_and_every_word_is_said() {
    for (i, entry) in EFFECTS.iter().enumerate() {
        let spec = &entry.spec;
        assert!(EFFECTS[..i].iter().all(|e| e.spec.name != spec.name), "{}", spec.name);
        assert!(!spec.doc.is_empty() && !spec.source.is_empty() && !spec.params.is_empty(), "{}", spec.name);
        assert!(!spec.hooks.is_empty() && effect(spec.name).is_some());
        assert!((1..=spec.params.len()).contains(&entry.amplitudes), "{}", spec.name);
        for p in spec.params {
            assert!(p.min <= p.default && p.default <= p.max && p.min < p.max, "{}.{}", spec.name, p.name);
            assert!(!p.unit.is_empty() && !p.doc.is_empty(), "{}.{}", spec.name, p.name);
        }
        for (name, _) in entry.seeds {
            assert!(spec.params.iter().any(|p| p.name == *name), "{}: no parameter {name}", spec.name);
        }
    }
}

#[test]
fn an_effect_without_amplitude_is_absent_whatever_its_other_parameters() {
    for entry in EFFECTS {
        let mut p = present(entry);
        assert!(flat(entry, &p, &ONE).iter().any(|v| *v != 0.0), "{}", entry.spec.name);
        for (value, spec) in p.iter_mut().zip(entry.spec.params).take(entry.amplitudes) {
            assert_eq!(spec.default, 0.0, "{}.{}", entry.spec.name, spec.name);
            *value = 0.0;
        }
        // Numbers that mean nothing alone: a damper without its spring, shear without friction.
        let beside = ["soft_contact", "contact_friction"].contains(&entry.spec.name);
        let alone = |v: &f64| beside && *v == p[1] || *v == 0.0;
        // Several amplitudes: a law that is the sum of two, each of which has its own.
        let sum_of_laws =
            ["damping", "friction_offset", "gliding_friction", "cushion"].contains(&entry.spec.name);
        let p = if sum_of_laws { defaults(entry) } else { p.clone() };
        assert!(flat(entry, &p, &ONE).iter().all(alone), "{}", entry.spec.name);
    }
}

#[test]
fn every_parameter_changes_something_and_derivatives_are_the_differences() {
    for entry in EFFECTS {
        let (base, count) = (present(entry), entry.spec.params.len());
        for k in 0..count + ONE.len() {
            let with = |h: f64| {
                let (mut p, mut s) = (base.clone(), ONE);
                if k < count {
                    p[k] += h
                } else {
                    s[k - count] += h
                }
                flat(entry, &p, &s)
            };
            let mut p: Vec<Jet> = base.iter().map(|&v| Jet::constant(v)).collect();
            let mut s: State<Jet> = constants(ONE);
            if k < count {
                p[k] = p[k].with_derivative(0, 1.0)
            } else {
                s[k - count] = s[k - count].with_derivative(0, 1.0)
            }
            let exact: Vec<f64> = flat(entry, &p, &s).iter().map(|j| j.derivative(0)).collect();
            let h = 1e-6;
            let numeric: Vec<f64> = with(h).iter().zip(with(-h)).map(|(u, d)| (u - d) / (2.0 * h)).collect();
            let name = entry.spec.params.get(k).map_or("state", |q| q.name);
            let name = format!("{}.{name}", entry.spec.name);
            assert!(k >= count || exact.iter().any(|d| *d != 0.0), "{name} changes nothing");
            for (e, n) in exact.iter().zip(&numeric) {
                assert!((e - n).abs() <= 1e-4 * (1.0 + n.abs()), "{name}: {e} {n}");
            }
        }
    }
}

#[test]
fn hooks_that_are_not_declared_do_nothing() {
    for entry in EFFECTS {
        for (hook, values) in output(entry, &present(entry), &ONE) {
            let acts = values.iter().any(|v| *v != 0.0);
            assert_eq!(entry.uses(hook), acts, "{} {hook:?}", entry.spec.name);
        }
    }
}

/// A change of the world: a turn, then a mirror of x, then a shift.
#[derive(Clone, Copy)]
struct Change {
    turn: f64,
    mirror: bool,
    shift: Vec2,
}

impl Change {
    fn vector(&self, v: Vec2) -> Vec2 {
        let v = v.rotated(Vec2::from_angle(self.turn));
        if self.mirror { vec2(-v.x, v.y) } else { v }
    }

    fn body(&self, b: &Body<f64>) -> Body<f64> {
        let flip = if self.mirror { -1.0 } else { 1.0 };
        Body {
            position: self.vector(b.position) + self.shift,
            yaw: flip * (b.yaw + self.turn),
            velocity: self.vector(b.velocity),
            spin: flip * b.spin,
            // Turn rates are axial: a mirror turns them round once more.
            roll: self.vector(b.roll).scaled(flip),
            ..*b
        }
    }
}

#[test]
fn forces_have_the_symmetry_they_declare() {
    let change = |turn, mirror, x, y| Change { turn, mirror, shift: vec2(x, y) };
    let all = [
        change(0.0, false, 0.4, -1.3),
        change(0.9, false, 0.0, 0.0),
        change(-2.0, false, 0.7, 0.2),
        change(0.0, true, 0.0, 0.0),
        change(1.1, true, -0.6, 0.8),
    ];
    for entry in EFFECTS.iter().filter(|e| e.uses(Hook::Force) || e.uses(Hook::Pair)) {
        let (p, hooks) = (present(entry), f64::hooks(entry));
        let mut kept = [true; 5];
        for (change, kept) in all.iter().zip(&mut kept) {
            // About a centre: changes of the place relative to it.
            let centre = match entry.symmetry {
                Symmetry::About { center, .. } => vec2(p[center], p[center + 1]),
                _ => vec2(0.0, 0.0),
            };
            let place = |b: Body<f64>| Body { position: b.position + centre, ..b };
            let (one, other) = (body(&ONE), body(&OTHER));
            let act = |a: &Body<f64>, b: &Body<f64>| {
                let mut w = Wrench::zero();
                (hooks.force)(&p, TIME, a, &mut w);
                (
                    w.force + (hooks.pair)(&p, a, b),
                    w.friction_limit
                        + w.load_concentration
                        + w.rolling_resistance
                        + w.damping
                        + w.spin_damping
                        + w.friction_excess,
                    w.torque,
                    w.friction_arm + w.friction_skew + w.diagonal_load,
                )
            };
            let (before, after) = (
                act(&place(one), &place(other)),
                act(&place(change.body(&one)), &place(change.body(&other))),
            );
            let flip = if change.mirror { -1.0 } else { 1.0 };
            *kept = (change.vector(before.0) - after.0).norm() < 1e-12
                && (before.1 - after.1).abs() < 1e-12
                && (flip * before.2 - after.2).abs() < 1e-12
                && (flip * before.3 - after.3).abs() < 1e-12;
        }
        let expected = match entry.symmetry {
            Symmetry::Isotropic => [true; 5],
            Symmetry::Chiral => [true, true, true, false, false],
            Symmetry::Shifts => [true, false, false, false, false],
            // A patch's edge is too thin for the shifts to meet it.
            Symmetry::About { .. } if entry.spec.name == "friction_patch" => kept,
            Symmetry::About { mirrors, .. } => [false, true, false, mirrors, false],
            Symmetry::None => kept,
        };
        assert_eq!(kept, expected, "{}", entry.spec.name);
    }
}

#[test]
fn what_knows_no_place_and_no_time_adds_no_energy() {
    let sourceless = |e: &&EffectEntry| matches!(e.symmetry, Symmetry::Isotropic | Symmetry::Chiral);
    for entry in EFFECTS.iter().filter(sourceless) {
        let p = present(entry);
        for turn in 0..8 {
            let change = Change { turn: turn as f64, mirror: turn % 2 == 0, shift: vec2(0.3, turn as f64) };
            let b = change.body(&body(&ONE));
            let mut w = Wrench::zero();
            (f64::hooks(entry).force)(&p, TIME, &b, &mut w);
            let power = w.force.dot(b.velocity) + w.torque * b.spin;
            assert!(power <= 1e-12, "{}: {power} W", entry.spec.name);
            let bounds =
                [w.friction_limit, w.rolling_resistance, w.spin_friction_limit, w.damping, w.spin_damping];
            assert!(bounds.iter().all(|v| *v >= 0.0), "{}: {bounds:?}", entry.spec.name);
        }
    }
}

#[test]
fn profiles_name_effects_and_parameters_that_exist() {
    for entry in EFFECTS {
        let (name, profile) = (entry.spec.name, entry.profile);
        assert!(profile.covers.iter().all(|covered| effect(covered).is_some()), "{name}");
        let roles = profile.param_roles.iter().map(|(parameter, _)| parameter);
        let priors = profile.nuisance_priors.iter().map(|(parameter, _)| parameter);
        for parameter in roles.chain(priors) {
            assert!(entry.spec.params.iter().any(|p| p.name == *parameter), "{name}: {parameter}");
        }
        if let Some(values) = entry.all_or_nothing() {
            assert_eq!(values.len(), entry.spec.params.len(), "{name}");
        }
        if entry.obstacle().is_some() {
            let roles =
                [0, entry.spec.params.len() - 1].map(|k| profile.param_role(entry.spec.params[k].name));
            assert_eq!(roles, [Some(ParamRole::Presence), Some(ParamRole::WallRestitution)], "{name}");
        }
        let is_matter = entry.uses(Hook::Matter);
        let is_camera = entry.uses(Hook::Observe) || entry.uses(Hook::Clock);
        assert_eq!(profile.role == Role::Matter, is_matter, "{name}");
        assert_eq!(profile.role == Role::Camera, is_camera, "{name}");
    }
}

#[test]
fn a_room_finds_effects_by_what_they_do() {
    let named = |found: Vec<&EffectEntry>| -> Vec<&str> { found.iter().map(|e| e.spec.name).collect() };
    let all = |property: fn(&&EffectEntry) -> bool| named(EFFECTS.iter().filter(property).collect());
    assert_eq!(
        all(|e| !e.is_candidate()),
        ["friction_offset", "gliding_friction", "damping", "contact_distance"]
    );
    assert_eq!(all(|e| e.of_objects()), ["mass_change", "wrong_size", "off_centre_marker"]);
    assert_eq!(all(|e| e.profile.holds_at_rest), ["sliding_friction", "gliding_friction"]);
    assert_eq!(all(|e| e.all_or_nothing().is_some()), ["sticky_contact"]);
    assert_eq!(all(|e| e.profile.acts_on == ActsOn::SlidingFeet), ["friction_offset"]);
    assert_eq!(all(|e| e.profile.acts_on == ActsOn::TableWalls), ["cushion"]);
    assert_eq!(all(|e| e.profile.changes_after_contact), ["ball_spin"]);
    let parameter = |role| parameter_with(role).map(|(e, p)| (e.spec.name, p.name));
    assert_eq!(parameter(ParamRole::ObjectRestitution), Some(("restitution", "object")));
    assert_eq!(
        effect_with(|e| e.obstacle() == Some(ObstacleForm::Disc)).map(|e| e.spec.name),
        Some("hidden_object")
    );
}

#[test]
fn seeds_cover_the_region_and_are_in_bounds() {
    let region = Region { low: vec2(-2.0, -1.0), high: vec2(2.0, 3.0), duration: 4.0, places: 4 };
    for entry in EFFECTS {
        let seeds = entry.seeds(&region);
        assert!((1..=4096).contains(&seeds.len()), "{}: {} seeds", entry.spec.name, seeds.len());
        for seed in &seeds {
            let inside = |(v, q): (&f64, &ParamSpec)| (q.min..=q.max).contains(v);
            assert!(seed.iter().zip(entry.spec.params).all(inside), "{}: {seed:?}", entry.spec.name);
            assert!(seed[..entry.amplitudes].iter().all(|v| *v == 0.0), "{}", entry.spec.name);
        }
    }
    let places = effect("attractor_spring").expect("it is there").seeds(&region);
    assert_eq!((places.len(), places[0][1], places[15][2]), (16, -1.5, 2.5));
}

#[test]
fn reports_join_vectors_and_turn_amplitudes_into_the_quantities_of_the_field() {
    use Quantity::{Number, Vector, Word};
    let check = |name: &str, p: &[f64], expected: &[(&str, Quantity)]| {
        let entry = effect(name).expect(name);
        assert_eq!((entry.report)(p), expected, "{name}");
    };
    check("uniform_force", &[0.3, -0.1], &[("F", Vector([0.3, -0.1]))]);
    check(
        "friction_patch",
        &[1.5, 1.0, 2.0, 0.4],
        &[("center", Vector([1.0, 2.0])), ("radius", Number(0.4)), ("k", Number(2.5))],
    );
    check(
        "attractor_spring",
        &[0.2, 1.0, 2.0],
        &[("form", Word("spring")), ("k", Number(0.2)), ("center", Vector([1.0, 2.0]))],
    );
    check("speed_dependent_restitution", &[0.5], &[("v0", Number(2.0))]);
    check(
        "hidden_wall",
        &[1.0, 2.0, 0.0, 0.7],
        &[("point", Vector([2.0, 0.0])), ("normal", Vector([1.0, 0.0])), ("restitution", Number(0.7))],
    );
    check("sticky_contact", &[1.0, 0.5], &[("strength", Number(2.0))]);
    check("sticky_contact", &[1.0, 0.0], &[]);
    check("soft_contact", &[0.1, 3.0], &[("stiffness", Number(1.0 / (0.1 * 0.1))), ("damping", Number(3.0))]);
    check(
        "time_periodic",
        &[-0.3, -0.4, 1.2, -1.0],
        &[
            ("a", Number(0.5)),
            ("f", Number(1.2)),
            ("phi", Number(std::f64::consts::PI - 1.0)),
            ("direction", Vector([0.6, 0.8])),
        ],
    );
    assert_eq!(effect("attractor_inverse_square").expect("it is there").kind, "attractor");
}
