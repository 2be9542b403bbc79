//! What laws that users write do to bodies.

use super::motion::{Kinematics, Laws};
use crate::body::{Body, Wrench};
use crate::effects::Scalar;
use crate::effects::program::Push;
use crate::num::Vec2;

impl<T: Scalar> Laws<T> {
    pub fn has_formulas(&self) -> bool {
        !self.formulas.is_empty()
    }

    /// Whether formulas do to body `i` what they do in `other`, which is of the same model.
    pub fn same_written(&self, other: &Self, i: usize) -> bool
    where
        T: PartialEq,
    {
        let numbers = self.formulas.iter().zip(&other.formulas).all(|(a, b)| a.1[i] == b.1[i]);
        numbers && self.mass[i] == other.mass[i] && self.shapes[i] == other.shapes[i]
    }

    /// Adds what the formulas do to body `i`.
    pub fn add_written(&self, i: usize, k: &Kinematics<T>, time: T, out: &mut Wrench<T>) {
        for (program, values) in &self.formulas {
            if !program.force(&values[i], time, &self.body(i, k), out) {
                self.undefined.set(true);
            }
        }
    }
}

impl Laws<f64> {
    /// What the formulas do to body `i` at these instants; nothing where one has no finite value.
    pub fn written(&self, i: usize, instants: &[(f64, Kinematics<f64>)]) -> Vec<Push> {
        let bodies: Vec<(f64, Body<f64>)> =
            instants.iter().map(|(time, k)| (*time, self.body(i, k))).collect();
        let mut sum = vec![(Vec2::zero(), 0.0); instants.len()];
        for (program, values) in &self.formulas {
            for (sum, push) in sum.iter_mut().zip(program.pushes(&values[i], &bodies)) {
                let (force, torque) = push.unwrap_or_default();
                *sum = (sum.0 + force, sum.1 + torque);
            }
        }
        sum
    }
}
