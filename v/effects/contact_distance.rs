//! Outlines that touch before they meet, or after.

use super::{Effect, EffectSpec, Hook, ParamSpec, Scope};
use crate::num::Real;

pub struct ContactDistance;

impl Effect for ContactDistance {
    const SPEC: EffectSpec = EffectSpec {
        name: "contact_distance",
        doc: "Two objects touch when their outlines are this far apart (overlap, where it is negative): an engine finds contacts within a margin and only when a step ends, and no object is quite the shape that it is taken for.",
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

    fn margin<T: Real>(p: &[T]) -> T {
        p[0]
    }
}

/// Outlines are never farther off than this when they touch (m).
pub const MOST_MARGIN: f64 = 0.02;
