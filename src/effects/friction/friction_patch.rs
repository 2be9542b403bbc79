//! A round patch of ground that is rougher, or smoother, than the rest.

use crate::body::{Body, Wrench};
use crate::effects::{CENTER, Effect, EffectSpec, Hook, ParamSpec, Quantity, Scope, Seed, Seeds, Symmetry};
use crate::num::{Real, vec2};

/// The edge is a ramp this far to either side (m), so that derivatives by place and radius exist.
const EDGE: f64 = 0.005;

pub struct FrictionPatch;

impl Effect for FrictionPatch {
    const SPEC: EffectSpec = EffectSpec {
        name: "friction_patch",
        doc: "A rough or slippery spot: the ground's friction (every mu) is 1 + excess times larger while the centre is in the disc.",
        source: "Coulomb's law on uneven ground",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "excess",
                unit: "1",
                default: 0.0,
                min: -1.0,
                max: 50.0,
                scope: Scope::Setup,
                doc: "k - 1: by how much more friction there is",
            },
            CENTER[0],
            CENTER[1],
            ParamSpec {
                name: "radius",
                unit: "m",
                default: 0.5,
                min: 0.01,
                max: 10.0,
                scope: Scope::Setup,
                doc: "radius of the patch",
            },
        ],
    };
    const SYMMETRY: Symmetry = Symmetry::About { center: 1, mirrors: true };
    const SEEDS: Seeds = &[("center_x", Seed::PlaceX), ("center_y", Seed::PlaceY), ("radius", Seed::Reach)];

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        let center = Quantity::Vector([p[1], p[2]]);
        vec![("center", center), ("radius", Quantity::Number(p[3])), ("k", Quantity::Number(1.0 + p[0]))]
    }

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        let inside = p[3] - (body.position - vec2(p[1], p[2])).norm();
        let share = ((inside * (0.5 / EDGE)) + 0.5).max(T::zero()).min(T::constant(1.0));
        out.friction_excess += p[0] * share * share * (-share * 2.0 + 3.0);
    }
}
