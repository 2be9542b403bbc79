//! A law that no library lists: a sparse sum of generic terms that explains the residual acceleration.

use super::force::{Lens, Seen};
use super::free::Free;
use crate::num::{Vec2, vec2};
use crate::world::{Kinematics, Model};
use nalgebra::DMatrix;

/// Most terms of a formula.
pub const MOST_TERMS: usize = 6;
/// Most terms of a formula that contradicts a law of the library: a longer one could imitate any.
pub const SIMPLE_TERMS: usize = 2;
/// Fall of chi-square, in units of what remains, that a term must bring beyond its price.
const PROOF: f64 = 20.0;

/// One generic term: its text along x and along y, and its value.
struct Term {
    x: &'static str,
    y: &'static str,
    value: fn(&Kinematics<f64>, f64) -> Vec2,
}

/// Terms of position, velocity and spin up to second order, by axis where the law may have no symmetry.
const TERMS: [Term; 20] = [
    Term { x: "1", y: "", value: |_, _| vec2(1.0, 0.0) },
    Term { x: "", y: "1", value: |_, _| vec2(0.0, 1.0) },
    Term { x: "x", y: "", value: |k, _| vec2(k.position.x, 0.0) },
    Term { x: "y", y: "", value: |k, _| vec2(k.position.y, 0.0) },
    Term { x: "", y: "x", value: |k, _| vec2(0.0, k.position.x) },
    Term { x: "", y: "y", value: |k, _| vec2(0.0, k.position.y) },
    Term { x: "vx", y: "vy", value: |k, _| k.velocity },
    Term { x: "-vy", y: "vx", value: |k, _| k.velocity.perp() },
    Term { x: "vx*speed", y: "vy*speed", value: |k, _| k.velocity.scaled(k.velocity.norm()) },
    Term { x: "vx*speed^2", y: "vy*speed^2", value: |k, _| k.velocity.scaled(k.velocity.norm_squared()) },
    Term { x: "vx/speed", y: "vy/speed", value: |k, _| k.velocity.unit() },
    Term { x: "-vy*speed", y: "vx*speed", value: |k, _| k.velocity.perp().scaled(k.velocity.norm()) },
    Term { x: "-spin*vy", y: "spin*vx", value: |k, _| k.velocity.perp().scaled(k.spin) },
    Term { x: "vx", y: "", value: |k, _| vec2(k.velocity.x, 0.0) },
    Term { x: "", y: "vy", value: |k, _| vec2(0.0, k.velocity.y) },
    Term { x: "x^3", y: "", value: |k, _| vec2(k.position.x.powi(3), 0.0) },
    Term { x: "", y: "y^3", value: |k, _| vec2(0.0, k.position.y.powi(3)) },
    Term { x: "x^2", y: "", value: |k, _| vec2(k.position.x.powi(2), 0.0) },
    Term { x: "", y: "y^2", value: |k, _| vec2(0.0, k.position.y.powi(2)) },
    Term { x: "t", y: "", value: |_, t| vec2(t, 0.0) },
];

/// A sparse law and what it leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualLaw {
    pub text: String,
    pub terms: usize,
    /// Chi-square that remains, with the priors' share.
    pub cost: f64,
}

/// The sparse law beside the models' own, as `let c1 = ...; ax = ...; ay = ...` with accelerations in m/s^2 (of a body that
/// does not roll) of at most `most` terms; `None` where no term proves itself.
pub fn residual_law(
    lens: &Lens,
    models: &[Model],
    free: &[Free],
    seen: &Seen,
    most: usize,
) -> Option<ResidualLaw> {
    let projector = lens.projector(models, free, &seen.values)?;
    // The same law for all masses, or a force: the data say which.
    let laws = [false, true].map(|force| select(lens, models, &projector, seen.cost, force, most));
    laws.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))
}

/// Forward selection.
fn select(
    lens: &Lens,
    models: &[Model],
    projector: &super::force::Projector,
    start: f64,
    force: bool,
    most: usize,
) -> Option<ResidualLaw> {
    let all: Vec<_> = TERMS.iter().map(|t| lens.column(models, force, t.value)).collect();
    let degrees = lens.degrees_of_freedom().max(1) as f64;
    let unexplained = lens.joint(projector, start, &DMatrix::zeros(projector.residual.len(), 0))?.0;
    let mut chosen: Vec<usize> = vec![];
    let mut best = (0.0, vec![]);
    while chosen.len() < most {
        let tried = (0..TERMS.len()).filter(|k| !chosen.contains(k)).filter_map(|k| {
            let with: Vec<usize> = chosen.iter().copied().chain([k]).collect();
            let columns = DMatrix::from_columns(&with.iter().map(|&c| all[c].clone()).collect::<Vec<_>>());
            let (cost, amplitudes) = lens.joint(projector, start, &columns)?;
            Some((unexplained - cost, amplitudes.as_slice().to_vec(), k))
        });
        let Some((gain, amplitudes, k)) = tried.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        let remains = ((unexplained - gain) / degrees).max(1.0);
        if (gain - best.0) / remains < PROOF + degrees.ln() {
            break;
        }
        chosen.push(k);
        best = (gain, amplitudes);
    }
    if chosen.is_empty() {
        return None;
    }
    let side = |text: fn(&Term) -> &'static str| {
        let parts = chosen.iter().enumerate().filter(|(_, k)| !text(&TERMS[**k]).is_empty());
        let sum: Vec<String> = parts.map(|(i, k)| format!("c{}*({})", i + 1, text(&TERMS[*k]))).collect();
        let sum = if sum.is_empty() { "0".to_string() } else { sum.join(" + ") };
        if force { format!("({sum})/m") } else { sum }
    };
    let amplitudes: String =
        best.1.iter().enumerate().map(|(i, a)| format!("let c{} = {a:.4e}; ", i + 1)).collect();
    let text = format!("{amplitudes}ax = {}; ay = {}", side(|t| t.x), side(|t| t.y));
    Some(ResidualLaw { text, terms: chosen.len(), cost: unexplained - best.0 })
}
