//! Masses of the bodies and the forces that the active effects exert on them.

use crate::body::{Body, BodyCorrection, Wrench};
use crate::effects::formula::{ForceAndTorque, FormulaProgram};
use crate::effects::{Hook, Hooks, Scalar};
use crate::num::Vec2;
use crate::scene::Shape;
use crate::world::model::{BODY_VALUES, MASS, Model};
use crate::world::motion::kinematics::Kinematics;
use std::cell::Cell;

/// The active effects and masses of one simulation, resolved for each body.
pub(in crate::world) struct Dynamics<T: Scalar> {
    pub shapes: Vec<Shape>,
    pub mass: Vec<T>,
    pub inverse_mass: Vec<T>,
    pub inverse_inertia: Vec<T>,
    /// Relative growth of each outline. Its value is zero, it carries derivatives; empty where there are none.
    pub growth: Vec<T>,
    forces: Vec<PerBody<T>>,
    pairs: Vec<PerBody<T>>,
    /// Each with its parameters, body by body.
    formulas: Vec<(FormulaProgram, Vec<Vec<T>>)>,
    /// Whether a formula had no finite value so far.
    undefined: Cell<bool>,
    /// For each body, whether neither its mass nor a parameter of its forces carries derivatives.
    pub constant: Vec<bool>,
    /// The shortest time in which a force may change much by itself (s).
    pub time_scale: f64,
}

/// One effect's hooks with its parameters, body by body.
struct PerBody<T: Scalar> {
    hooks: &'static Hooks<T>,
    values: Vec<T>,
    count: usize,
}

impl<T: Scalar> PerBody<T> {
    fn of(&self, body: usize) -> &[T] {
        &self.values[body * self.count..(body + 1) * self.count]
    }
}

/// Mass and size of each body as factors of the values in the model.
fn corrections<T: Scalar>(model: &Model, flat: &[T]) -> Vec<BodyCorrection<T>> {
    let one = T::constant(1.0);
    let mut corrections = vec![BodyCorrection { mass: one, size: one }; model.bodies.len()];
    for (active, entry, first) in model.active().filter(|(_, entry, _)| entry.uses(Hook::Matter)) {
        for (body, correction) in model.bodies.iter().zip(&mut corrections) {
            (T::hooks(entry).matter)(&active.values_for(first, flat, body, body), correction);
        }
    }
    corrections
}

impl<T: Scalar> Dynamics<T> {
    /// Under the numbers `flat` ([`Model::flatten`]).
    pub fn new(model: &Model, flat: &[T]) -> Self {
        let (mut forces, mut pairs, mut time_scale) = (vec![], vec![], f64::INFINITY);
        for (active, entry, first) in model.active() {
            let hooks = T::hooks(entry);
            let values = |body| active.values_for(first, flat, body, body);
            let (force, pair) = (entry.uses(Hook::Force), entry.uses(Hook::Pair));
            if !force && !pair {
                continue;
            }
            let (values, count): (Vec<T>, _) =
                (model.bodies.iter().flat_map(values).collect(), active.parameters.len());
            time_scale = values.chunks_exact(count.max(1)).map(hooks.pace).fold(time_scale, f64::min);
            let list = if force { &mut forces } else { &mut pairs };
            list.push(PerBody { hooks, values, count });
        }
        let (mut formulas, mut undefined) = (vec![], false);
        for (active, formula, first) in model.formulas() {
            let Ok(program) = formula.read() else {
                undefined = true;
                continue;
            };
            time_scale = time_scale.min(program.pace());
            let values = |body| active.values_for(first, flat, body, body);
            formulas.push((program, model.bodies.iter().map(values).collect::<Vec<_>>()));
        }
        let mut dynamics = Dynamics::without_forces(model, flat);
        let plain = |values: &[T]| values.iter().all(|p| p.is_constant());
        let constant = (0..model.bodies.len()).map(|i| {
            let formulas = formulas.iter().all(|(_, values): &(_, Vec<Vec<T>>)| plain(&values[i]));
            dynamics.mass[i].is_constant() && formulas && forces.iter().all(|law| plain(law.of(i)))
        });
        dynamics.constant = constant.collect();
        (dynamics.forces, dynamics.pairs, dynamics.formulas) = (forces, pairs, formulas);
        (dynamics.undefined, dynamics.time_scale) = (Cell::new(undefined), time_scale);
        dynamics
    }

    /// Masses and shapes alone.
    fn without_forces(model: &Model, flat: &[T]) -> Self {
        let one = T::constant(1.0);
        let corrections = corrections(model, flat);
        let shapes: Vec<Shape> =
            model.bodies.iter().zip(&corrections).map(|(b, m)| b.shape.scaled(m.size.value())).collect();
        let mut growth: Vec<T> =
            corrections.iter().map(|m| (m.size / m.size.value()).infinitesimal()).collect();
        if growth.iter().all(|g| g.is_constant()) {
            growth.clear();
        }
        let given = (0..shapes.len()).map(|i| flat[i * BODY_VALUES.len() + MASS]);
        let mass: Vec<T> = given.zip(&corrections).map(|(m, correction)| m * correction.mass).collect();
        let inverse_mass: Vec<T> = mass.iter().map(|&m| one / m).collect();
        let mut inverse_inertia: Vec<T> =
            inverse_mass.iter().zip(&shapes).map(|(&m, s)| m / s.unit_inertia()).collect();
        for ((inertia, shape), growth) in inverse_inertia.iter_mut().zip(&shapes).zip(&growth) {
            // A ball's speeds at its surface do not depend on its size.
            if !shape.is_ball() {
                *inertia *= -*growth * 2.0 + 1.0;
            }
        }
        Dynamics {
            shapes,
            mass,
            inverse_mass,
            inverse_inertia,
            growth,
            forces: vec![],
            pairs: vec![],
            formulas: vec![],
            undefined: Cell::new(false),
            constant: vec![],
            time_scale: f64::INFINITY,
        }
    }

    pub fn body(&self, i: usize, k: &Kinematics<T>) -> Body<T> {
        Body {
            shape: self.shapes[i],
            mass: self.mass[i],
            position: k.position,
            yaw: k.yaw,
            velocity: k.velocity,
            spin: k.spin,
            roll: k.roll,
        }
    }

    /// The wrench of all forces on body `i`, without those between pairs.
    pub fn wrench(&self, i: usize, k: &Kinematics<T>, time: T) -> Wrench<T> {
        let mut out = self.library_wrench(i, k, time);
        for (program, values) in &self.formulas {
            if !program.force(&values[i], time, &self.body(i, k), &mut out) {
                self.undefined.set(true);
            }
        }
        out
    }

    /// The same without formulas.
    pub fn library_wrench(&self, i: usize, k: &Kinematics<T>, time: T) -> Wrench<T> {
        let body = self.body(i, k);
        let mut out = Wrench::zero();
        for law in &self.forces {
            (law.hooks.force)(law.of(i), time, &body, &mut out);
        }
        if out.friction_excess.value() != 0.0 || !out.friction_excess.is_constant() {
            let factor = out.friction_excess + 1.0;
            out.friction_limit *= factor;
            out.rolling_resistance *= factor;
            out.rolling_torque *= factor;
            out.spin_friction_limit *= factor;
        }
        out
    }

    /// Whether bodies act on each other at a distance.
    pub fn has_pair_forces(&self) -> bool {
        !self.pairs.is_empty()
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

    pub fn has_formulas(&self) -> bool {
        !self.formulas.is_empty()
    }

    /// Whether a formula had no finite value.
    pub fn is_undefined(&self) -> bool {
        self.undefined.get()
    }
}

/// Comparisons with another set of values of the same model.
impl<T: Scalar + PartialEq> Dynamics<T> {
    /// Whether all that acts on body `i` alone has the same values in `other`.
    pub fn same_forces(&self, other: &Self, i: usize) -> bool {
        let forces = self.forces.iter().zip(&other.forces).all(|(a, b)| a.of(i) == b.of(i));
        forces && self.same_formulas(other, i)
    }

    /// Whether the formulas exert the same forces on body `i` in `other`.
    pub fn same_formulas(&self, other: &Self, i: usize) -> bool {
        let values = self.formulas.iter().zip(&other.formulas).all(|(a, b)| a.1[i] == b.1[i]);
        values && self.mass[i] == other.mass[i] && self.shapes[i] == other.shapes[i]
    }

    /// Whether bodies exert the same forces on each other at a distance in `other`.
    pub fn same_pairs(&self, other: &Self) -> bool {
        let laws = self.pairs.iter().zip(&other.pairs).all(|(a, b)| a.values == b.values);
        self.pairs.is_empty() || (laws && self.mass == other.mass && self.shapes == other.shapes)
    }
}

impl Dynamics<f64> {
    /// Forces and torques of the formulas on body `i` at these instants (s); zero where one has no finite value.
    pub fn formula_forces(&self, i: usize, instants: &[(f64, Kinematics<f64>)]) -> Vec<ForceAndTorque> {
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
