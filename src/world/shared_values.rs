//! What models of one set-up take over from each other; they have the same effects in the same order.

use super::model::Model;

impl Model {
    /// Takes the beliefs of another model; where it stands is left as it is.
    pub fn copy_priors_from(&mut self, other: &Model) {
        for (active, own) in self.effects.iter_mut().zip(&other.effects) {
            for (p, q) in active.parameters.iter_mut().zip(&own.parameters) {
                (p.means, p.prior) = (q.means.clone(), q.prior);
            }
        }
    }

    /// Puts the bodies, and what each scene has for itself, where another model of the scene has them; beliefs stay.
    pub fn copy_state_from(&mut self, other: &Model) {
        self.bodies.clone_from(&other.bodies);
        for (active, own) in self.effects.iter_mut().zip(&other.effects) {
            for (p, q) in active.parameters.iter_mut().zip(&own.parameters).filter(|(_, q)| !own.shares(q)) {
                p.values.clone_from(&q.values);
            }
        }
    }

    /// Takes the shared numbers that a model of another scene has too.
    pub fn copy_shared_from(&mut self, other: &Model) {
        for (active, own) in self.effects.iter_mut().zip(&other.effects) {
            for (p, q) in active.parameters.iter_mut().zip(&own.parameters).filter(|(_, q)| own.shares(q)) {
                for (label, value) in p.labels.iter().zip(&mut p.values) {
                    if let Ok(at) = q.labels.binary_search(label) {
                        *value = q.values[at];
                    }
                }
            }
        }
    }
}
