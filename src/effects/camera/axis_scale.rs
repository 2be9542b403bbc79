//! Axes of the picture with different scales: an error of the camera that imitates friction which depends on the direction.

use crate::body::Observation;
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Quantity, Scope, Symmetry};
use crate::num::Real;

pub struct AxisScale;

impl Effect for AxisScale {
    const SPEC: EffectSpec = EffectSpec {
        name: "axis_scale",
        doc: "The axes of the picture have different scales: x_seen = (1 + excess/2) x, y_seen = (1 - excess/2) y.",
        source: "Hartley and Zisserman, Multiple View Geometry, sec. 6.1: pixels that are not square",
        hooks: &[Hook::Observe],
        params: &[ParamSpec {
            name: "excess",
            unit: "1",
            default: 0.0,
            min: -0.5,
            max: 0.5,
            scope: Scope::Setup,
            doc: "scale of x less that of y, over their mean",
        }],
    };
    const PROFILE: Profile = Profile {
        shows_at_contacts: true,
        // A ruler of 0.2 m in the picture is read to a millimetre at each end.
        negligible: 0.01,
        ..Profile::CAMERA
    };
    const SYMMETRY: Symmetry = Symmetry::None;

    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        let half = 0.5 * p[0];
        vec![("ratio", Quantity::Number((1.0 + half) / (1.0 - half)))]
    }

    fn observe<T: Real>(p: &[T], out: &mut Observation<T>) {
        let half = p[0] * 0.5;
        out.position.x *= half + 1.0;
        out.position.y *= -half + 1.0;
    }
}
