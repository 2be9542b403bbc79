//! Accelerations that a model predicts for bodies in free motion, without simulation. Fits of force laws compare them.

use crate::body::Wrench;
use crate::effects::formula::ForceAndTorque;
use crate::num::Vec2;
use crate::world::model::Model;
use crate::world::motion::dynamics::Dynamics;
use crate::world::motion::ground_friction::Mode;
use crate::world::motion::kinematics::{IslandVec, Kinematics};
use crate::world::observation::ObservationModel;
use std::borrow::Cow;

/// The motion of some bodies at one instant.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// s.
    pub time: f64,
    /// Index of the body and its motion.
    pub bodies: Vec<(usize, Kinematics<f64>)>,
}

/// A model at given values: accelerations of bodies without contacts, and the observation of their positions.
pub struct AccelerationField<'m> {
    model: &'m Model,
    dynamics: Dynamics<f64>,
    observation: ObservationModel,
}

/// Forces of the formulas at the values of a field.
pub struct FormulaForces<'f, 'm> {
    of: &'f AccelerationField<'m>,
    /// By body, in the order of the instants that contain it.
    pushes: Vec<Vec<ForceAndTorque>>,
}

impl<'m> AccelerationField<'m> {
    /// Under the numbers `flat` ([`Model::flatten`]).
    pub fn new(model: &'m Model, flat: &[f64]) -> Self {
        AccelerationField {
            model,
            dynamics: Dynamics::new(model, flat),
            observation: ObservationModel::new(model, flat),
        }
    }

    /// For each body, whether its acceleration or observation may differ from that in `other`, which is of the same model.
    pub fn differs(&self, other: &AccelerationField) -> Vec<bool> {
        let same = |i: usize| {
            self.dynamics.same_forces(&other.dynamics, i) && self.observation.same(&other.observation, i)
        };
        // A pair force moves all bodies.
        let pulls = !self.dynamics.same_pairs(&other.dynamics);
        (0..self.model.bodies.len()).map(|i| pulls || !same(i)).collect()
    }

    /// Forces of the formulas on each body of the instants, for other values of the remaining parameters.
    pub fn formula_forces<'f>(&'f self, instants: &[Snapshot]) -> FormulaForces<'f, 'm> {
        let all = (0..self.model.bodies.len()).map(|i| self.formula_forces_on(i, instants));
        FormulaForces { of: self, pushes: all.collect() }
    }

    /// On body `i`, at the instants that contain it; empty without formulas.
    fn formula_forces_on(&self, i: usize, instants: &[Snapshot]) -> Vec<ForceAndTorque> {
        if !self.dynamics.has_formulas() {
            return vec![];
        }
        let here = |s: &Snapshot| s.bodies.iter().find(|b| b.0 == i).map(|b| (s.time, b.1));
        self.dynamics.formula_forces(i, &instants.iter().filter_map(here).collect::<Vec<_>>())
    }

    /// Acceleration (m/s^2) of each body of each instant, in order; zero for bodies that are not in `which`. Balls whose start rolls are
    /// taken to roll. `known` may hold the forces of the formulas at the same instants.
    pub fn accelerations(
        &self,
        instants: &[Snapshot],
        which: Option<&[bool]>,
        known: Option<&FormulaForces>,
    ) -> Vec<Vec2> {
        let dynamics = &self.dynamics;
        let wanted = |i: usize| which.is_none_or(|which| which[i]);
        let forces = |i: usize| match known {
            _ if !wanted(i) => Cow::default(),
            Some(known) if dynamics.same_formulas(&known.of.dynamics, i) => Cow::from(&known.pushes[i]),
            _ => Cow::from(self.formula_forces_on(i, instants)),
        };
        let forces: Vec<Cow<[ForceAndTorque]>> = (0..self.model.bodies.len()).map(forces).collect();
        let mut forces: Vec<_> = forces.iter().map(|pushes| pushes.iter()).collect();
        let rate = |i: usize, k: &Kinematics<f64>, w: &Wrench<f64>| {
            let rolls = self.model.bodies[i].start.rolling;
            dynamics.rates(i, k, if rolls { Mode::Roll } else { Mode::Slide }, w).velocity
        };
        let mut all = Vec::with_capacity(instants.iter().map(|s| s.bodies.len()).sum());
        for Snapshot { time, bodies } in instants {
            let wrench = |&(i, ref k): &(usize, Kinematics<f64>)| {
                if !wanted(i) {
                    return Wrench::zero();
                }
                let mut out = dynamics.library_wrench(i, k, *time);
                if let Some((force, torque)) = forces[i].next() {
                    out.force += *force;
                    out.torque += *torque;
                }
                out
            };
            let mut wrenches: IslandVec<Wrench<f64>> = bodies.iter().map(wrench).collect();
            if dynamics.has_pair_forces() {
                let (members, motions): (Vec<usize>, Vec<Kinematics<f64>>) = bodies.iter().copied().unzip();
                dynamics.add_pair_forces(&members, &motions, &mut wrenches);
            }
            all.extend(bodies.iter().zip(&wrenches).map(|((i, k), w)| match wanted(*i) {
                true => rate(*i, k, w),
                false => Vec2::zero(),
            }));
        }
        all
    }

    /// Position of body `i` (m) that the camera reports as `observed` (m), at this yaw (rad).
    pub fn true_position(&self, i: usize, observed: Vec2, yaw: f64) -> Vec2 {
        self.observation.true_position(i, observed, yaw)
    }

    /// How much larger the camera shows a small step of body `i` at this true position (m) and yaw (rad).
    pub fn magnification(&self, i: usize, position: Vec2, yaw: f64) -> f64 {
        self.observation.magnification(i, position, yaw)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::formula::Formula;
    use crate::num::vec2;
    use crate::world::{ActiveEffect, Preset};

    #[test]
    fn a_parameter_changes_only_the_bodies_to_which_it_applies() {
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
        let [before, after] = [&flat, &to].map(|flat| AccelerationField::new(&model, flat));
        assert_eq!(after.differs(&before), rubber);
        let before = before.accelerations(&instants, None, None);
        let (all, some) =
            (after.accelerations(&instants, None, None), after.accelerations(&instants, Some(&rubber), None));
        for (i, rubber) in rubber.iter().enumerate() {
            assert_eq!(all[i] != before[i], *rubber);
            assert_eq!(some[i], if *rubber { all[i] } else { Vec2::zero() });
        }
        // Known forces of formulas are used only where their values have not changed.
        let formula = Formula::new("let k = 0.3; fx = -k*x*vx; torque = k*t", vec![]).expect("a formula");
        let formula = ActiveEffect::of_formula("drag", formula, &model.bodies).expect("a formula");
        model.effects.push(formula);
        let (flat, to) = (model.flatten(), [&to[..], &[0.3]].concat());
        let other = to.iter().map(|v| if *v == 0.3 { 0.4 } else { *v }).collect::<Vec<_>>();
        let [before, after, other] = [&flat, &to, &other].map(|flat| AccelerationField::new(&model, flat));
        let known = before.formula_forces(&instants);
        for field in [&after, &other] {
            let fresh = field.accelerations(&instants, None, None);
            assert_eq!(field.accelerations(&instants, None, Some(&known)), fresh);
            assert_ne!(before.accelerations(&instants, None, None), fresh);
        }
        assert!(after.accelerations(&instants, None, None) != other.accelerations(&instants, None, None));
        // With pair forces every body depends on all values.
        let pulls = crate::effects::effect("pair_attraction").expect("an effect");
        model.effects.push(ActiveEffect::new(&pulls.spec, &model.bodies));
        let (flat, mut to) = (model.flatten(), model.flatten());
        *to.last_mut().expect("numbers") += 0.1;
        assert!(
            AccelerationField::new(&model, &to)
                .differs(&AccelerationField::new(&model, &flat))
                .iter()
                .all(|a| *a)
        );
    }
}
