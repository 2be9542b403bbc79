//! Accelerations that a model gives to bodies in free motion, without simulating: what a fit of forces compares.

use super::model::Model;
use super::motion::{Kinematics, Laws, Mode};
use super::observation::ObservationModel;
use super::simulate::Few;
use crate::body::Wrench;
use crate::effects::program::Push;
use crate::num::Vec2;
use std::borrow::Cow;

/// Where some bodies were at one instant.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// s.
    pub time: f64,
    /// Index of the body and its motion.
    pub bodies: Vec<(usize, Kinematics<f64>)>,
}

/// A model at some numbers: what bodies do in free motion, nobody touching anybody, and where they are seen.
pub struct AccelerationField<'m> {
    model: &'m Model,
    laws: Laws<f64>,
    views: ObservationModel,
}

/// What formulas do at the numbers of a field.
pub struct FormulaForces<'f, 'm> {
    of: &'f AccelerationField<'m>,
    /// By body, in the order of the instants in which it is.
    pushes: Vec<Vec<Push>>,
}

impl<'m> AccelerationField<'m> {
    /// Under the numbers `flat` ([`Model::flatten`]).
    pub fn new(model: &'m Model, flat: &[f64]) -> Self {
        AccelerationField { model, laws: Laws::new(model, flat), views: ObservationModel::new(model, flat) }
    }

    /// By index, the bodies that may accelerate otherwise, or be seen elsewhere, than in `other`, which is of the same model.
    pub fn differs(&self, other: &AccelerationField) -> Vec<bool> {
        let same = |i: usize| self.laws.same(&other.laws, i) && self.views.same(&other.views, i);
        // What bodies do to each other moves all of them.
        let pulls = !self.laws.same_pairs(&other.laws);
        (0..self.model.bodies.len()).map(|i| pulls || !same(i)).collect()
    }

    /// What formulas do to each body of the instants, for other numbers of the rest.
    pub fn formula_forces<'f>(&'f self, instants: &[Snapshot]) -> FormulaForces<'f, 'm> {
        let all = (0..self.model.bodies.len()).map(|i| self.written_on(i, instants));
        FormulaForces { of: self, pushes: all.collect() }
    }

    /// To body `i` in those of the instants in which it is; empty without formulas.
    fn written_on(&self, i: usize, instants: &[Snapshot]) -> Vec<Push> {
        if !self.laws.has_formulas() {
            return vec![];
        }
        let here = |s: &Snapshot| s.bodies.iter().find(|b| b.0 == i).map(|b| (s.time, b.1));
        self.laws.written(i, &instants.iter().filter_map(here).collect::<Vec<_>>())
    }

    /// Acceleration (m/s^2) of each body of each instant, one after the other. Balls that begin to roll are taken to roll. Those of
    /// bodies that are not in `which` are zero. What formulas do there at the same numbers may be `known`.
    pub fn accelerations(
        &self,
        instants: &[Snapshot],
        which: Option<&[bool]>,
        known: Option<&FormulaForces>,
    ) -> Vec<Vec2> {
        let laws = &self.laws;
        let wanted = |i: usize| which.is_none_or(|which| which[i]);
        let written = |i: usize| match known {
            _ if !wanted(i) => Cow::default(),
            Some(known) if laws.same_written(&known.of.laws, i) => Cow::from(&known.pushes[i]),
            _ => Cow::from(self.written_on(i, instants)),
        };
        let written: Vec<Cow<[Push]>> = (0..self.model.bodies.len()).map(written).collect();
        let mut written: Vec<_> = written.iter().map(|pushes| pushes.iter()).collect();
        let rate = |i: usize, k: &Kinematics<f64>, w: &Wrench<f64>| {
            let rolls = self.model.bodies[i].start.rolling;
            laws.rates(i, k, if rolls { Mode::Roll } else { Mode::Slide }, w).velocity
        };
        let mut all = Vec::with_capacity(instants.iter().map(|s| s.bodies.len()).sum());
        for Snapshot { time, bodies } in instants {
            let wrench = |&(i, ref k): &(usize, Kinematics<f64>)| {
                if !wanted(i) {
                    return Wrench::zero();
                }
                let mut out = laws.of_library(i, k, *time);
                if let Some((force, torque)) = written[i].next() {
                    out.force += *force;
                    out.torque += *torque;
                }
                out
            };
            let mut wrenches: Few<Wrench<f64>> = bodies.iter().map(wrench).collect();
            if laws.has_pair_forces() {
                let (members, motions): (Vec<usize>, Vec<Kinematics<f64>>) = bodies.iter().copied().unzip();
                laws.add_pair_forces(&members, &motions, &mut wrenches);
            }
            all.extend(bodies.iter().zip(&wrenches).map(|((i, k), w)| match wanted(*i) {
                true => rate(*i, k, w),
                false => Vec2::zero(),
            }));
        }
        all
    }

    /// Where body `i` is when the camera reports it at `seen` (m) with this yaw (rad).
    pub fn true_position(&self, i: usize, seen: Vec2, yaw: f64) -> Vec2 {
        self.views.true_position(i, seen, yaw)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::formula::Formula;
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
        let [before, after] = [&flat, &to].map(|flat| AccelerationField::new(&model, flat));
        assert_eq!(after.differs(&before), rubber);
        let before = before.accelerations(&instants, None, None);
        let (all, some) =
            (after.accelerations(&instants, None, None), after.accelerations(&instants, Some(&rubber), None));
        for (i, rubber) in rubber.iter().enumerate() {
            assert_eq!(all[i] != before[i], *rubber);
            assert_eq!(some[i], if *rubber { all[i] } else { Vec2::zero() });
        }
        // What formulas do need not be found anew where their numbers are as they were.
        let formula = Formula::new("let k = 0.3; fx = -k*x*vx; torque = k*t", vec![]).expect("it is one");
        let formula = ActiveEffect::of_formula("drag", formula, &model.bodies).expect("it is one");
        model.effects.push(formula);
        let (flat, to) = (model.flatten(), [&to[..], &[0.3]].concat());
        let other = to.iter().map(|v| if *v == 0.3 { 0.4 } else { *v }).collect::<Vec<_>>();
        let [before, after, other] = [&flat, &to, &other].map(|flat| AccelerationField::new(&model, flat));
        let known = before.formula_forces(&instants);
        for field in [&after, &other] {
            let anew = field.accelerations(&instants, None, None);
            assert_eq!(field.accelerations(&instants, None, Some(&known)), anew);
            assert_ne!(before.accelerations(&instants, None, None), anew);
        }
        assert!(after.accelerations(&instants, None, None) != other.accelerations(&instants, None, None));
        // Bodies that pull at each other feel what befalls any of them.
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
