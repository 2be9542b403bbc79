//! Forces of bodies on each other at a distance.

use super::motion::{Kinematics, Laws};
use crate::body::{Body, Wrench};
use crate::effects::Scalar;

impl<T: Scalar> Laws<T> {
    /// Whether bodies act on each other at a distance.
    pub fn has_pair_forces(&self) -> bool {
        !self.pairs.is_empty()
    }

    /// Whether bodies do to each other at a distance what they do in `other`, which is of the same model.
    pub fn same_pairs(&self, other: &Self) -> bool
    where
        T: PartialEq,
    {
        let laws = self.pairs.iter().zip(&other.pairs).all(|(a, b)| a.values == b.values);
        self.pairs.is_empty() || (laws && self.mass == other.mass && self.shapes == other.shapes)
    }

    /// Adds the pair forces among `members`.
    pub fn add_pair_forces(&self, members: &[usize], k: &[Kinematics<T>], out: &mut [Wrench<T>]) {
        let bodies: Vec<Body<T>> = members.iter().zip(k).map(|(&i, k)| self.body(i, k)).collect();
        for law in &self.pairs {
            for (x, &i) in members.iter().enumerate() {
                for y in x + 1..members.len() {
                    let f = (law.hooks.pair)(law.of(i), &bodies[x], &bodies[y]);
                    out[x].force += f;
                    out[y].force -= f;
                }
            }
        }
    }
}
