//! The model: bodies, walls and active effects with their parameters, as plain data.

use crate::effects::formula::{Formula, FormulaError, FormulaParameter};
use crate::effects::{EffectEntry, EffectSpec, Hook, ParamId, ParamRole, ParamSpec, Scope, effect};
use crate::num::{Real, Vec2};
use crate::scene::Shape;
use crate::world::trace::State;
use crate::world::unknown_impulse::{IMPULSE_VALUES, UnknownImpulse};
use serde::{Deserialize, Serialize};
use smallvec::SmallVec;
use std::fmt;

/// A physical model of one scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Name of the preset from which it was made.
    pub preset: String,
    pub bodies: Vec<BodySpec>,
    pub walls: Vec<Wall>,
    pub effects: Vec<ActiveEffect>,
    /// Prior standard deviation of the logarithm of a mass that the scene does not give.
    pub mass_sd: f64,
    /// Prior standard deviation of a moving ball's initial spin about each axis, as the speed of its surface (m/s); 0: balls start
    /// as their [`Start`] says.
    #[serde(default)]
    pub spin_sd: f64,
    /// Corrections of a prediction by observations; a fit has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty", rename = "anchors")]
    pub corrections: Vec<StateCorrection>,
    /// What something unseen does to bodies of this video.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub impulses: Vec<UnknownImpulse>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BodySpec {
    /// The scene's id of the object.
    pub id: u32,
    pub material: String,
    pub shape: Shape,
    /// kg; relative where the scene gives none.
    pub mass: f64,
    pub start: Start,
}

/// The state of a body at the time when it enters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// s.
    pub time: f64,
    pub state: State,
    /// Whether a ball rolls without slip: its roll follows from its velocity, and `state.roll` is not read.
    pub rolling: bool,
}

/// A static line segment; bodies touch it from any side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Wall {
    pub name: String,
    pub from: Vec2,
    pub to: Vec2,
}

/// At `time` a body is moved by these amounts, which removes the error that the model has made until then.
/// A body that touches another is not moved, and a body at rest stays at rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StateCorrection {
    /// The object's id.
    pub id: u32,
    /// s.
    pub time: f64,
    /// m.
    pub position: Vec2,
    /// m/s; a ball's roll changes with it.
    pub velocity: Vec2,
    /// rad.
    pub yaw: f64,
    /// rad/s about z.
    pub spin: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "StoredEffect")]
pub struct ActiveEffect {
    pub name: String,
    pub on: bool,
    /// In the order of the effect's spec, or of its formula.
    pub parameters: Vec<Parameter>,
    /// The law itself if the user wrote it; then the name is the user's too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub formula: Option<Formula>,
}

/// An active effect as stored. One of an earlier version lacks the parameters that its law has gained since.
#[derive(Deserialize)]
struct StoredEffect {
    name: String,
    on: bool,
    parameters: Vec<Parameter>,
    #[serde(default)]
    formula: Option<Formula>,
}

impl From<StoredEffect> for ActiveEffect {
    fn from(stored: StoredEffect) -> Self {
        let StoredEffect { name, on, mut parameters, formula } = stored;
        let entry = effect(&name).filter(|_| formula.is_none());
        let missing = entry.into_iter().flat_map(|e| e.spec.params).skip(parameters.len());
        let default = |p: &ParamSpec| Prior { mean: p.default, sd: 0.0 };
        parameters.extend(missing.map(|p| Parameter::new(p.name, p.scope, default(p), &[])));
        ActiveEffect { name, on, parameters, formula }
    }
}

/// One parameter of an effect: a value for each label of its scope (materials, object ids, pairs "1-3").
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    pub name: String,
    pub scope: Scope,
    /// Sorted; one empty label in scope `Setup`.
    pub labels: Vec<String>,
    pub values: Vec<f64>,
    /// Prior mean of each value.
    pub means: Vec<f64>,
    /// Prior of a value without a label yet; standard deviation 0 keeps values fixed.
    pub prior: Prior,
    /// The shared parameter that an intervention has split into one value for each object: an added object takes its value from it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shared: Option<Box<Parameter>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    pub mean: f64,
    pub sd: f64,
}

/// What a number of the model belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValueOwner {
    Shared,
    /// Index of the body.
    Body(usize),
    /// Indices of two bodies; it acts when they meet.
    Pair(usize, usize),
}

/// Numbers that describe one body in [`Model::flatten`], in this order.
pub const BODY_VALUES: [&str; 9] = ["x", "y", "yaw", "vx", "vy", "spin", "roll_x", "roll_y", "mass"];

/// Indices of the spin vector among [`BODY_VALUES`].
pub const SPINS: std::ops::RangeInclusive<usize> = 5..=7;

/// Index of the mass among [`BODY_VALUES`].
pub const MASS: usize = 8;

/// Bounds of a mass that the scene does not give (kg).
pub const MASS_BOUNDS: [f64; 2] = [1e-3, 1e3];

impl Model {
    pub fn body_index(&self, id: u32) -> Option<usize> {
        self.bodies.iter().position(|b| b.id == id)
    }

    pub fn effect(&self, name: &str) -> Option<&ActiveEffect> {
        self.effects.iter().find(|e| e.name == name)
    }

    /// All numbers of the model: [`BODY_VALUES`] of each body, then the values of each effect's parameters in order, then
    /// [`IMPULSE_VALUES`] of each impulse.
    pub fn flatten(&self) -> Vec<f64> {
        let mut flat = Vec::with_capacity(self.flat_len());
        for body in &self.bodies {
            let s = &body.start.state;
            flat.extend([s.position.x, s.position.y, s.yaw, s.velocity.x, s.velocity.y]);
            flat.extend([s.spin, s.roll.x, s.roll.y, body.mass]);
        }
        for parameter in self.parameters() {
            flat.extend(&parameter.values);
        }
        flat.extend(self.impulses.iter().flat_map(UnknownImpulse::values));
        flat
    }

    /// This model with other numbers, laid out as [`flatten`](Self::flatten) does.
    pub fn with_values(&self, flat: &[f64]) -> Model {
        debug_assert_eq!(flat.len(), self.flat_len());
        let mut model = self.clone();
        let mut rest = flat.iter().copied();
        let mut next = || rest.next().unwrap_or(0.0);
        for body in &mut model.bodies {
            let s = &mut body.start.state;
            for slot in
                [&mut s.position.x, &mut s.position.y, &mut s.yaw, &mut s.velocity.x, &mut s.velocity.y]
            {
                *slot = next();
            }
            for slot in [&mut s.spin, &mut s.roll.x, &mut s.roll.y, &mut body.mass] {
                *slot = next();
            }
        }
        for effect in &mut model.effects {
            for value in effect.parameters.iter_mut().flat_map(|p| &mut p.values) {
                *value = next();
            }
        }
        for impulse in &mut model.impulses {
            impulse.set_values([next(), next(), next(), next()]);
        }
        model
    }

    pub fn flat_len(&self) -> usize {
        let of_effects: usize = self.parameters().map(|p| p.values.len()).sum();
        BODY_VALUES.len() * self.bodies.len() + of_effects + IMPULSE_VALUES.len() * self.impulses.len()
    }

    /// For each number of [`flatten`](Self::flatten), what it belongs to.
    pub fn owners(&self) -> Vec<ValueOwner> {
        let bodies = (0..self.bodies.len()).flat_map(|b| [ValueOwner::Body(b); BODY_VALUES.len()]);
        let of = |parameter: &Parameter, label: &str| {
            let mut ids = label.split('-').map(|id| id.parse().ok().and_then(|id| self.body_index(id)));
            match (parameter.scope, ids.next().flatten(), ids.next().flatten()) {
                (Scope::Object, Some(a), _) => ValueOwner::Body(a),
                (Scope::Pair, Some(a), Some(b)) => ValueOwner::Pair(a, b),
                _ => ValueOwner::Shared,
            }
        };
        let of_effects = self.parameters().flat_map(|p| p.labels.iter().map(move |l| of(p, l)));
        let pushed = |i: &UnknownImpulse| self.body_index(i.id).map_or(ValueOwner::Shared, ValueOwner::Body);
        let of_impulses = self.impulses.iter().flat_map(|i| [pushed(i); IMPULSE_VALUES.len()]);
        bodies.chain(of_effects).chain(of_impulses).collect()
    }

    /// Whether bodies act on each other at a distance.
    pub fn has_pair_forces(&self) -> bool {
        let pairs = |e: &&ActiveEffect| e.on && effect(&e.name).is_some_and(|e| e.uses(Hook::Pair));
        self.effects.iter().any(|e| pairs(&e))
    }

    /// The effects that are on, with their entries and the index of their first value in [`flatten`](Self::flatten).
    pub(in crate::world) fn active(
        &self,
    ) -> impl Iterator<Item = (&ActiveEffect, &'static EffectEntry, usize)> {
        let mut next = BODY_VALUES.len() * self.bodies.len();
        self.effects.iter().filter_map(move |active| {
            let first = next;
            next += active.parameters.iter().map(|p| p.values.len()).sum::<usize>();
            let entry = effect(&active.name).filter(|_| active.on && active.formula.is_none())?;
            Some((active, entry, first))
        })
    }

    /// The formulas that are on, likewise.
    pub(in crate::world) fn formulas(&self) -> impl Iterator<Item = (&ActiveEffect, &Formula, usize)> {
        let mut next = BODY_VALUES.len() * self.bodies.len();
        self.effects.iter().filter_map(move |active| {
            let first = next;
            next += active.parameters.iter().map(|p| p.values.len()).sum::<usize>();
            Some((active, active.formula.as_ref().filter(|_| active.on)?, first))
        })
    }

    /// Parameters of all effects, in order.
    pub fn parameters(&self) -> impl Iterator<Item = &Parameter> {
        self.effects.iter().flat_map(|e| &e.parameters)
    }

    /// Adds a body; parameters that have no value for it take their prior's mean.
    pub fn add_body(&mut self, body: BodySpec) {
        self.bodies.push(body);
        let bodies = &self.bodies;
        for parameter in self.effects.iter_mut().flat_map(|e| &mut e.parameters) {
            parameter.cover(bodies);
        }
    }

    /// Removes a body; parameters keep their values.
    pub fn remove_body(&mut self, index: usize) {
        self.bodies.remove(index);
    }
}

impl BodySpec {
    /// A new velocity at the start (m/s); a ball rolls with it.
    pub fn set_velocity(&mut self, velocity: Vec2) {
        self.start.state.velocity = velocity;
        if self.shape.is_ball() {
            self.start.rolling = true;
        }
    }
}

impl ActiveEffect {
    /// The parameters as they apply to body `a` (in contact with `b`, or the same body without contact). The effect's values start
    /// at `first` in `flat`.
    pub(in crate::world) fn values_for<T: Real>(
        &self,
        first: usize,
        flat: &[T],
        a: &BodySpec,
        b: &BodySpec,
    ) -> Vec<T> {
        let mut first = first;
        let value = |p: &Parameter| {
            let at = first;
            first += p.values.len();
            p.index(a, b).map_or(T::constant(p.prior.mean), |k| flat[at + k])
        };
        self.parameters.iter().map(value).collect()
    }

    /// Whether the videos of a set-up share the values of this parameter. Properties of an object stay with its id from
    /// video to video; parameters of its motion and contacts do not.
    pub fn shares(&self, parameter: &Parameter) -> bool {
        let own = matches!(parameter.scope, Scope::Object | Scope::Pair);
        !own || effect(&self.name).is_some_and(|e| e.uses(Hook::Matter) || e.uses(Hook::Observe))
    }

    /// The meaning of one of its parameters, if it has one for the code that handles all effects alike.
    pub fn role_of(&self, parameter: &Parameter) -> Option<ParamRole> {
        effect(&self.name)?.profile.param_role(&parameter.name)
    }

    /// Its parameter with this meaning.
    pub fn parameter(&self, role: ParamRole) -> Option<&Parameter> {
        self.parameters.iter().find(|p| self.role_of(p) == Some(role))
    }

    /// The effect as its spec gives it, with a value for every body.
    pub fn new(spec: &EffectSpec, bodies: &[BodySpec]) -> Self {
        let parameters = spec.params.iter().map(|p| {
            let prior = Prior { mean: p.default, sd: 0.0 };
            Parameter::new(p.name, p.scope, prior, bodies)
        });
        let parameters = parameters.collect();
        ActiveEffect { name: spec.name.to_string(), on: true, parameters, formula: None }
    }

    /// A formula of the user under the user's name; all bodies share its parameters.
    pub fn of_formula(name: &str, formula: Formula, bodies: &[BodySpec]) -> Result<Self, FormulaError> {
        formula.read()?;
        let own = |p: &FormulaParameter| {
            let prior = Prior { mean: p.default, sd: 0.0 };
            Parameter::new(&p.name, Scope::Setup, prior, bodies)
        };
        let parameters = formula.parameters.iter().map(own).collect();
        Ok(ActiveEffect { name: name.to_string(), on: true, parameters, formula: Some(formula) })
    }

    /// Unit and bounds of a parameter, as the spec or the formula gives them.
    pub fn bounds(&self, parameter: usize) -> Option<(&str, f64, f64)> {
        match &self.formula {
            Some(formula) => formula.parameters.get(parameter).map(|p| (p.unit.as_str(), p.min, p.max)),
            None => effect(&self.name)?.spec.params.get(parameter).map(|p| (p.unit, p.min, p.max)),
        }
    }
}

impl Parameter {
    pub fn new(name: &str, scope: Scope, prior: Prior, bodies: &[BodySpec]) -> Self {
        let (name, shared) = (name.to_string(), None);
        let mut parameter =
            Parameter { name, scope, labels: vec![], values: vec![], means: vec![], prior, shared };
        parameter.cover(bodies);
        parameter
    }

    /// Adds a value for every label that the bodies need and that has none.
    fn cover(&mut self, bodies: &[BodySpec]) {
        for (i, a) in bodies.iter().enumerate() {
            let partners = match self.scope {
                Scope::ShapePair | Scope::Pair => &bodies[..i],
                _ => &bodies[i..=i],
            };
            for b in partners {
                let label = self.label(a, b);
                if let Err(at) = self.labels.binary_search(&label) {
                    let shared = self.shared.as_ref().and_then(|s| s.values.get(s.index(a, b)?).copied());
                    self.labels.insert(at, label);
                    self.values.insert(at, shared.unwrap_or(self.prior.mean));
                    self.means.insert(at, self.prior.mean);
                }
            }
        }
    }

    /// Gives each body, also one that is added later, a value of its own, which at first is the one that applies to it.
    pub(in crate::world) fn split_by_object(&mut self, bodies: &[BodySpec]) {
        if self.scope == Scope::Object {
            return;
        }
        let mut own = Parameter::new(&self.name, Scope::Object, self.prior, &[]);
        own.shared = Some(Box::new(self.clone()));
        own.cover(bodies);
        *self = own;
    }

    /// Name of one value in reports: `sliding_friction.mu[rubber]`.
    pub fn full_name(&self, of: &ActiveEffect, label: &str) -> String {
        ParamId { effect: &of.name, parameter: &self.name, label }.to_string()
    }

    /// Index of the value that applies to body `a` (in contact with `b`, or the same body without contact).
    pub fn index(&self, a: &BodySpec, b: &BodySpec) -> Option<usize> {
        // Called for every contact: the label is built on the stack.
        let mut label = Label(SmallVec::new());
        self.write_label(a, b, &mut label).ok()?;
        self.labels.binary_search_by(|l| l.as_bytes().cmp(&label.0)).ok()
    }

    fn label(&self, a: &BodySpec, b: &BodySpec) -> String {
        let mut label = String::new();
        // Writing to a string never fails.
        let _ = self.write_label(a, b, &mut label);
        label
    }

    fn write_label(&self, a: &BodySpec, b: &BodySpec, to: &mut impl fmt::Write) -> fmt::Result {
        match self.scope {
            Scope::Setup => Ok(()),
            Scope::Material => to.write_str(&a.material),
            Scope::Shape => to.write_str(a.shape.word()),
            Scope::Object => write!(to, "{}", a.id),
            Scope::ShapePair => {
                let (x, y) = (a.shape.word(), b.shape.word());
                to.write_str(x.min(y))?;
                to.write_str("-")?;
                to.write_str(x.max(y))
            }
            Scope::Pair => write!(to, "{}-{}", a.id.min(b.id), a.id.max(b.id)),
        }
    }
}

/// A label on the stack.
struct Label(SmallVec<[u8; 32]>);

impl fmt::Write for Label {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        self.0.extend_from_slice(part.as_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_stored_by_an_earlier_version_has_the_parameters_that_its_law_gained_since() {
        let now = effect("contact_friction").map(|e| ActiveEffect::new(&e.spec, &[]));
        let now = now.expect("it is in the library");
        let mut before = now.clone();
        before.parameters.truncate(1);
        let written = serde_json::to_string(&before).expect("it is plain data");
        assert_eq!(serde_json::from_str::<ActiveEffect>(&written).expect("it was written so"), now);
    }
}
