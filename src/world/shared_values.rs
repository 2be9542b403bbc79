//! Values that models of one set-up copy from each other. They have the same effects in the same order.

use crate::world::model::Model;

impl Model {
    /// Copies the priors of another model; values stay.
    pub fn copy_priors_from(&mut self, other: &Model) {
        for (active, own) in self.effects.iter_mut().zip(&other.effects) {
            for (p, q) in active.parameters.iter_mut().zip(&own.parameters) {
                (p.means, p.prior) = (q.means.clone(), q.prior);
            }
        }
    }

    /// Copies the bodies, the impulses and the values that videos do not share from another model of the scene; priors stay.
    pub fn copy_state_from(&mut self, other: &Model) {
        self.bodies.clone_from(&other.bodies);
        self.impulses.clone_from(&other.impulses);
        for (active, own) in self.effects.iter_mut().zip(&other.effects) {
            for (p, q) in active.parameters.iter_mut().zip(&own.parameters).filter(|(_, q)| !own.shares(q)) {
                p.values.clone_from(&q.values);
            }
        }
    }

    /// Copies the shared values that a model of another scene also has.
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
