//! Cubic drag: a force against the velocity that grows with its cube.

use crate::body::{Body, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct CubicDrag;

impl Effect for CubicDrag {
    const SPEC: EffectSpec = EffectSpec {
        name: "cubic_drag",
        doc: "Drag that grows with the cube of the speed: F = -c |v|^2 v.",
        source: "The odd cubic term of a drag's expansion in the velocity: Nayfeh and Mook, Nonlinear Oscillations, sec. 3.3",
        hooks: &[Hook::Force],
        params: &[ParamSpec {
            name: "c",
            unit: "kg s/m^2",
            default: 0.0,
            min: 0.0,
            max: 10.0,
            scope: Scope::Setup,
            doc: "force per cubed speed",
        }],
    };
    const PROFILE: Profile =
        Profile { common_name: Some("drag"), formula_terms: &[["vx*speed^2", "vy*speed^2"]], ..Profile::LAW };

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        out.force -= body.velocity * (p[0] * body.velocity.norm_squared());
    }
}
