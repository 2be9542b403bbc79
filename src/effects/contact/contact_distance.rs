//! A gap, or overlap, at which outlines touch.

use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Profile, Scope};
use crate::num::Real;

pub struct ContactDistance;

impl Effect for ContactDistance {
    const SPEC: EffectSpec = EffectSpec {
        name: "contact_distance",
        doc: "Two objects touch when their outlines are this far apart (overlap, where it is negative): engines find contacts within a margin and at the end of a step, and real outlines differ from their model.",
        source: "Catto, Understanding Constraints, GDC 2014 (speculative margin); collision margin and contact breaking threshold of Bullet",
        hooks: &[Hook::Margin],
        params: &[ParamSpec {
            name: "distance",
            unit: "m",
            default: 0.0,
            min: -MOST_MARGIN,
            max: MOST_MARGIN,
            scope: Scope::Pair,
            doc: "gap between the outlines at which they touch",
        }],
    };
    const PROFILE: Profile = Profile::NUISANCE;

    fn margin<T: Real>(p: &[T]) -> T {
        p[0]
    }
}

/// Largest gap or overlap at contact (m).
pub const MOST_MARGIN: f64 = 0.02;
