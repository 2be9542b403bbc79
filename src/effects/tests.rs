//! What holds for every effect in the table, also for those nobody has written yet.

use super::*;
use crate::num::vec2;
use crate::scene::Shape;

fn body<T: Real>(speed: f64) -> Body<T> {
    let c = T::constant;
    Body {
        shape: Shape::Square { half_side: 0.2 },
        mass: c(1.3),
        position: vec2(c(0.4), c(-0.7)),
        yaw: c(0.3),
        velocity: vec2(c(speed), c(-0.5)),
        spin: c(0.8),
        roll: vec2(c(0.1), c(2.0)),
    }
}

fn touching<T: Real>() -> Contact<T> {
    let c = T::constant;
    let normal = vec2(c(0.6), c(0.8));
    let b = Body { position: vec2(c(0.7), c(-0.3)), ..body(-1.0) };
    Contact { a: body(1.2), b: Some(b), normal, point: vec2(c(0.55), c(-0.5)), approach: c(1.1) }
}

/// Everything an effect gives, as one list of numbers.
fn output<T: Scalar>(entry: &EffectEntry, p: &[T]) -> Vec<T> {
    let hooks = T::hooks(entry);
    let mut w = Wrench::zero();
    (hooks.force)(p, T::constant(0.7), &body(1.2), &mut w);
    let pair = (hooks.pair)(p, &body(1.2), &Body { position: vec2(T::zero(), T::zero()), ..body(0.3) });
    let mut law = ContactLaw::plain();
    (hooks.contact)(p, p, &touching(), &mut law);
    let Wrench { force, torque, grip, lever, skew, rolling, damping, pivot, excess } = w;
    let mut all = vec![force.x, force.y, torque, grip, lever, skew, rolling, damping, pivot, excess];
    all.extend([pair.x, pair.y, law.restitution, law.friction]);
    all
}

/// Defaults, with the amplitude well inside its bounds.
fn present(entry: &EffectEntry) -> Vec<f64> {
    let mut p: Vec<f64> = entry.spec.params.iter().map(|q| q.default).collect();
    let first = &entry.spec.params[0];
    p[0] = first.default + 0.3 * (first.max.min(first.default + 1.0) - first.default);
    p
}

#[test]
fn names_are_unique_and_every_word_is_said() {
    for (i, entry) in EFFECTS.iter().enumerate() {
        let spec = &entry.spec;
        assert!(EFFECTS[..i].iter().all(|e| e.spec.name != spec.name), "{}", spec.name);
        assert!(!spec.doc.is_empty() && !spec.source.is_empty() && !spec.params.is_empty(), "{}", spec.name);
        assert!(!spec.hooks.is_empty() && effect(spec.name).is_some());
        for p in spec.params {
            assert!(p.min <= p.default && p.default <= p.max && p.min < p.max, "{}.{}", spec.name, p.name);
            assert!(!p.unit.is_empty() && !p.doc.is_empty(), "{}.{}", spec.name, p.name);
        }
    }
}

#[test]
fn an_effect_at_its_defaults_is_absent() {
    for entry in EFFECTS {
        let p: Vec<f64> = entry.spec.params.iter().map(|q| q.default).collect();
        assert!(output(entry, &p).iter().all(|v| *v == 0.0), "{}", entry.spec.name);
    }
}

#[test]
fn every_parameter_changes_something_and_its_derivative_is_the_difference() {
    for entry in EFFECTS {
        let base = present(entry);
        for k in 0..base.len() {
            let at = |h: f64| {
                let mut p = base.clone();
                p[k] += h;
                output(entry, &p)
            };
            let mut jets: Vec<Jet> = base.iter().map(|&v| Jet::constant(v)).collect();
            jets[k] = Jet::variable(base[k], 0);
            let exact: Vec<f64> = output(entry, &jets).iter().map(|j| j.d[0]).collect();
            let h = 1e-6;
            let numeric: Vec<f64> = at(h).iter().zip(at(-h)).map(|(u, d)| (u - d) / (2.0 * h)).collect();
            let name = format!("{}.{}", entry.spec.name, entry.spec.params[k].name);
            assert!(exact.iter().any(|d| *d != 0.0), "{name} changes nothing");
            for (e, n) in exact.iter().zip(&numeric) {
                assert!((e - n).abs() <= 1e-6 * (1.0 + n.abs()), "{name}: {e} {n}");
            }
        }
    }
}

#[test]
fn hooks_that_are_not_declared_do_nothing() {
    for entry in EFFECTS {
        let all = output(entry, &present(entry));
        let acts = |range: std::ops::Range<usize>| all[range].iter().any(|v| *v != 0.0);
        assert!(entry.uses(Hook::Force) || !acts(0..10), "{}", entry.spec.name);
        assert!(entry.uses(Hook::Pair) || !acts(10..12), "{}", entry.spec.name);
        assert!(entry.uses(Hook::Contact) || !acts(12..14), "{}", entry.spec.name);
    }
}
