//! Accelerations that a model gives to bodies in free motion, without simulating: what a fit of forces compares.

use super::model::Model;
use super::motion::{Kinematics, Laws, Mode};
use crate::body::Wrench;
use crate::num::Vec2;

/// Where some bodies were at one instant.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// s.
    pub time: f64,
    /// Index of the body and its motion.
    pub bodies: Vec<(usize, Kinematics<f64>)>,
}

/// Acceleration (m/s^2) of each body of each instant under the numbers `flat` ([`Model::flatten`]). Balls that
/// begin to roll are taken to roll; nobody touches anybody.
pub fn accelerations(model: &Model, flat: &[f64], instants: &[Snapshot]) -> Vec<Vec<Vec2>> {
    let laws = Laws::<f64>::new(model, flat);
    let one = |instant: &Snapshot| {
        let members: Vec<usize> = instant.bodies.iter().map(|b| b.0).collect();
        let motions: Vec<Kinematics<f64>> = instant.bodies.iter().map(|b| b.1).collect();
        let mut wrenches: Vec<Wrench<f64>> =
            instant.bodies.iter().map(|(i, k)| laws.wrench(*i, k, instant.time)).collect();
        if laws.has_pair_forces() {
            laws.add_pair_forces(&members, &motions, &mut wrenches);
        }
        let rates = instant.bodies.iter().zip(&wrenches).map(|((i, k), w)| {
            let rolls = model.bodies[*i].start.rolling;
            laws.rates(*i, k, if rolls { Mode::Roll } else { Mode::Slide }, w).velocity
        });
        rates.collect()
    };
    instants.iter().map(one).collect()
}
