//! Objects that attract each other at a distance.

use crate::body::Body;
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Scope, Seed, Seeds};
use crate::num::{Real, Vec2};

/// Parameters of a force between each two objects that is [`softened`].
pub(super) const SOFTENED: [ParamSpec; 2] = [
    ParamSpec {
        name: "S",
        unit: "N m^2",
        default: 0.0,
        min: 0.0,
        max: 50.0,
        scope: Scope::Setup,
        doc: "strength of each pair",
    },
    ParamSpec {
        name: "eps",
        unit: "m",
        default: 0.1,
        min: 0.001,
        max: 2.0,
        scope: Scope::Setup,
        doc: "distance within which the force is softened",
    },
];

pub struct PairAttraction;

impl Effect for PairAttraction {
    const SPEC: EffectSpec = EffectSpec {
        name: "pair_attraction",
        doc: "Objects pull at each other: F_i = S d/(d^2 + eps^2)^1.5, d = x_j - x_i.",
        source: "Newton's law with Plummer's softening (Mon. Not. R. Astron. Soc. 71 (1911) 460)",
        hooks: &[Hook::Pair],
        params: &SOFTENED,
    };
    const SEEDS: Seeds = &[("eps", Seed::Values(&[0.05, 0.2]))];

    fn pair<T: Real>(p: &[T], a: &Body<T>, b: &Body<T>) -> Vec2<T> {
        softened(b.position - a.position, p[1]) * p[0]
    }
}

/// `d/(d^2 + eps^2)^1.5`: the inverse square along `d`, softened within `eps` (m).
pub(in crate::effects) fn softened<T: Real>(d: Vec2<T>, eps: T) -> Vec2<T> {
    let square = d.norm_squared() + eps * eps;
    d * (T::constant(1.0) / (square * square.sqrt()))
}
