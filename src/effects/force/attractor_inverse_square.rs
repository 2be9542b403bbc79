//! A fixed source that attracts with the inverse square of the distance.

use crate::body::{Body, Wrench};
use crate::effects::pair::pair_attraction::softened;
use crate::effects::{CENTER, Effect, EffectSpec, Hook, ParamSpec, Scope, Seed, Seeds, Symmetry};
use crate::num::{Real, vec2};

pub struct AttractorInverseSquare;

impl Effect for AttractorInverseSquare {
    const SPEC: EffectSpec = EffectSpec {
        name: "attractor_inverse_square",
        doc: "Something pulls to a point, the harder the nearer: F = S d/(d^2 + eps^2)^1.5, d = center - x; negative S drives away.",
        source: "Coulomb's law with Plummer's softening (Mon. Not. R. Astron. Soc. 71 (1911) 460)",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "S",
                unit: "N m^2",
                default: 0.0,
                min: -50.0,
                max: 50.0,
                scope: Scope::Setup,
                doc: "strength of the source",
            },
            CENTER[0],
            CENTER[1],
            ParamSpec {
                name: "eps",
                unit: "m",
                default: 0.1,
                min: 0.001,
                max: 2.0,
                scope: Scope::Setup,
                doc: "distance within which the force is softened",
            },
        ],
    };
    const KIND: &str = "attractor";
    const FORM: Option<&str> = Some("inverse_square");
    const SYMMETRY: Symmetry = Symmetry::About { center: 1, mirrors: true };
    const SEEDS: Seeds =
        &[("center_x", Seed::PlaceX), ("center_y", Seed::PlaceY), ("eps", Seed::Values(&[0.1, 0.4, 1.0]))];

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force += softened(vec2(p[1], p[2]) - body.position, p[3]) * p[0];
    }
}
