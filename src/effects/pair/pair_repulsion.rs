//! Objects that push each other away at a distance.

use super::pair_attraction::{SOFTENED, softened};
use crate::body::Body;
use crate::effects::{Effect, EffectSpec, Hook, Seed, Seeds};
use crate::num::{Real, Vec2};

pub struct PairRepulsion;

impl Effect for PairRepulsion {
    const SPEC: EffectSpec = EffectSpec {
        name: "pair_repulsion",
        doc: "Objects push each other away: F_i = -S d/(d^2 + eps^2)^1.5, d = x_j - x_i.",
        source: "Coulomb's law with Plummer's softening (Mon. Not. R. Astron. Soc. 71 (1911) 460)",
        hooks: &[Hook::Pair],
        params: &SOFTENED,
    };
    const SEEDS: Seeds = &[("eps", Seed::Values(&[0.05, 0.2]))];

    fn pair<T: Real>(p: &[T], a: &Body<T>, b: &Body<T>) -> Vec2<T> {
        -softened(b.position - a.position, p[1]) * p[0]
    }
}
