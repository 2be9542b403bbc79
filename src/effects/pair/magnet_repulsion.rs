//! Magnets that stand upright in the objects and push each other away.

use crate::body::Body;
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Scope, Seed, Seeds};
use crate::num::{Real, Vec2};

pub struct MagnetRepulsion;

impl Effect for MagnetRepulsion {
    const SPEC: EffectSpec = EffectSpec {
        name: "magnet_repulsion",
        doc: "Upright magnets push each other away: F_i = -S d/(d^2 + eps^2)^2.5, d = x_j - x_i.",
        source: "Force between parallel dipoles side by side, 3 mu0 m^2/(4 pi r^4): Jackson, Classical Electrodynamics, sec. 5.7",
        hooks: &[Hook::Pair],
        params: &[
            ParamSpec {
                name: "S",
                unit: "N m^4",
                default: 0.0,
                min: 0.0,
                max: 50.0,
                scope: Scope::Setup,
                doc: "strength of each pair",
            },
            ParamSpec {
                name: "eps",
                unit: "m",
                default: 0.03,
                min: 0.001,
                max: 2.0,
                scope: Scope::Setup,
                doc: "distance within which the force is softened: about the size of the magnets",
            },
        ],
    };
    const KIND: &str = "pair_repulsion";
    const FORM: Option<&str> = Some("dipole");
    const SEEDS: Seeds = &[("eps", Seed::Values(&[0.02, 0.2]))];

    fn pair<T: Real>(p: &[T], a: &Body<T>, b: &Body<T>) -> Vec2<T> {
        let d = b.position - a.position;
        let square = d.norm_squared() + p[1] * p[1];
        d * (-p[0] / (square * square * square.sqrt()))
    }
}
