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
    accelerations_of(model, flat, instants, &vec![true; model.bodies.len()])
}

/// The same of some bodies, chosen by their index; those of the others are zero, but where bodies act on each other at a
/// distance, which needs them all.
pub fn accelerations_of(
    model: &Model,
    flat: &[f64],
    instants: &[Snapshot],
    which: &[bool],
) -> Vec<Vec<Vec2>> {
    let laws = Laws::<f64>::new(model, flat);
    let rate = |i: usize, k: &Kinematics<f64>, w: &Wrench<f64>| {
        let rolls = model.bodies[i].start.rolling;
        laws.rates(i, k, if rolls { Mode::Roll } else { Mode::Slide }, w).velocity
    };
    let one = |Snapshot { time, bodies }: &Snapshot| -> Vec<Vec2> {
        if laws.has_pair_forces() {
            let members: Vec<usize> = bodies.iter().map(|b| b.0).collect();
            let motions: Vec<Kinematics<f64>> = bodies.iter().map(|b| b.1).collect();
            let mut wrenches: Vec<Wrench<f64>> =
                bodies.iter().map(|(i, k)| laws.wrench(*i, k, *time)).collect();
            laws.add_pair_forces(&members, &motions, &mut wrenches);
            return bodies.iter().zip(&wrenches).map(|((i, k), w)| rate(*i, k, w)).collect();
        }
        let free = |(i, k): &(usize, Kinematics<f64>)| match which[*i] {
            true => rate(*i, k, &laws.wrench(*i, k, *time)),
            false => Vec2::zero(),
        };
        bodies.iter().map(free).collect()
    };
    instants.iter().map(one).collect()
}

/// By index, the bodies that may accelerate otherwise under the numbers `to` than under `from`.
pub fn affected(model: &Model, from: &[f64], to: &[f64]) -> Vec<bool> {
    let (from, to) = (Laws::<f64>::new(model, from), Laws::<f64>::new(model, to));
    (0..model.bodies.len()).map(|i| from.has_pair_forces() || !from.same(&to, i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::vec2;
    use crate::world::{ActiveEffect, Preset};

    #[test]
    fn a_number_moves_the_bodies_that_it_reaches() {
        let text = include_str!("../../tests/data/effects/bullet_coriolis_medium/scene_00/observed.json");
        let scene = crate::scene::parse("coriolis", text).expect("a scene");
        let mut model = Preset::named("table_glide").expect("a preset").model(&scene);
        let motion = |i: usize| Kinematics {
            position: vec2(i as f64, 0.0),
            yaw: 0.3,
            velocity: vec2(1.0, 0.5),
            spin: 0.2,
            roll: vec2(0.0, 0.0),
        };
        let bodies = (0..model.bodies.len()).map(|i| (i, motion(i))).collect();
        let instants = [Snapshot { time: 0.0, bodies }];
        let flat = model.flatten();
        let rubber: Vec<bool> = model.bodies.iter().map(|b| b.material == "rubber").collect();
        assert!(rubber.contains(&true) && rubber.contains(&false));
        let mut rougher = model.clone();
        for p in rougher.effects.iter_mut().flat_map(|e| &mut e.parameters) {
            p.labels.iter().zip(&mut p.values).filter(|(l, _)| *l == "rubber").for_each(|(_, v)| *v *= 2.0);
        }
        let to = rougher.flatten();
        assert_eq!(affected(&model, &flat, &to), rubber);
        let before = &accelerations(&model, &flat, &instants)[0];
        let (all, some) = (
            &accelerations(&model, &to, &instants)[0],
            &accelerations_of(&model, &to, &instants, &rubber)[0],
        );
        for (i, rubber) in rubber.iter().enumerate() {
            assert_eq!(all[i] != before[i], *rubber);
            assert_eq!(some[i], if *rubber { all[i] } else { Vec2::zero() });
        }
        // Bodies that pull at each other feel what befalls any of them.
        let pulls = crate::effects::effect("pair_attraction").expect("an effect");
        model.effects.push(ActiveEffect::new(&pulls.spec, &model.bodies));
        let (flat, mut to) = (model.flatten(), model.flatten());
        *to.last_mut().expect("numbers") += 0.1;
        assert!(affected(&model, &flat, &to).iter().all(|a| *a));
    }
}
