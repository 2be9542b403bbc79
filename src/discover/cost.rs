//! What a fit costs: its misfit, and how far it bends what was believed. A model that must bend its beliefs to follow the
//! measurements is worth less than one that need not.

use super::revise::{chi_squares, sum};
use crate::fit::Fit;
use crate::num::elementary;
use crate::world::Model;
use std::collections::BTreeSet;

/// Twice the negative log of likelihood and prior, but for constants.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// Chi-square of each scene.
    pub misfit: Vec<f64>,
    /// Squared deviations from the beliefs about what each scene has for itself, in units of theirs.
    own: Vec<f64>,
    /// The same of what scenes share; a scene that has it for itself pays for it.
    shared: f64,
}

impl Cost {
    /// Of a fit whose effect `added`, if there is one, is judged: its own numbers are paid by their count.
    pub fn of(fit: &Fit, added: Option<&str>) -> Cost {
        let mut seen = BTreeSet::new();
        let mut shared = 0.0;
        let mut of_model = |model: &Model| {
            let mut own = 0.0;
            for effect in model.effects.iter().filter(|e| e.on && added != Some(&e.name)) {
                for p in effect.parameters.iter().filter(|p| p.prior.sd > 0.0) {
                    for ((label, value), mean) in p.labels.iter().zip(&p.values).zip(&p.means) {
                        let square = elementary::powi((value - mean) / p.prior.sd, 2);
                        if !effect.shares(p) {
                            own += square;
                        } else if seen.insert((p.full_name(effect, label), value.to_bits())) {
                            shared += square;
                        }
                    }
                }
            }
            own
        };
        let own = fit.scenes.iter().map(|s| of_model(&s.model)).collect();
        Cost { misfit: chi_squares(fit), own, shared }
    }

    pub fn total(&self) -> f64 {
        sum(&self.misfit) + self.prior_penalty(|_| true)
    }

    /// Of one scene, without what it shares with others.
    pub fn of_scene(&self, scene: usize) -> f64 {
        self.misfit[scene] + self.own[scene]
    }

    /// What the beliefs of some scenes, and those that all share, cost.
    pub fn prior_penalty(&self, counts: impl Fn(usize) -> bool) -> f64 {
        self.shared + (0..self.own.len()).filter(|&k| counts(k)).map(|k| self.own[k]).sum::<f64>()
    }
}
