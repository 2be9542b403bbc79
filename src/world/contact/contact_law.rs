//! Contact laws of the active effects, and the gap at which two bodies touch.

use crate::body::{Body, Contact, ContactLaw};
use crate::effects::{ContactFn, Hook, MarginFn, Scalar};
use crate::num::Vec2;
use crate::world::model::{ActiveEffect, Model};
use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// An effect's hook, and where the effect's parameters begin.
struct ContactEffect<'m, F> {
    hook: F,
    active: &'m ActiveEffect,
    first: usize,
}

/// A body or wall and another, by index.
type Pair = (usize, usize);

/// The contact effects of a model, with the parameter values of the pairs that came near each other.
pub(in crate::world) struct ContactLaws<'m, T: Scalar> {
    model: &'m Model,
    flat: &'m [T],
    effects: Vec<ContactEffect<'m, ContactFn<T>>>,
    margin_effects: Vec<ContactEffect<'m, MarginFn<T>>>,
    /// For each pair that has met, the parameters of each effect as they apply to either body.
    values: BTreeMap<Pair, Vec<[Vec<T>; 2]>>,
    margins: RefCell<BTreeMap<Pair, T>>,
}

/// Where two bodies touch, and how fast they approach.
pub(in crate::world) struct ContactGeometry<T> {
    /// Unit normal from a to b.
    pub normal: Vec2<T>,
    /// m.
    pub point: Vec2<T>,
    /// m/s.
    pub approach: T,
}

impl<'m, T: Scalar> ContactLaws<'m, T> {
    /// Under the numbers `flat` ([`Model::flatten`]).
    pub fn new(model: &'m Model, flat: &'m [T]) -> Self {
        let with = |hook| model.active().filter(move |(_, entry, _)| entry.uses(hook));
        let effects = with(Hook::Contact).map(|(active, entry, first)| ContactEffect {
            hook: T::hooks(entry).contact,
            active,
            first,
        });
        let margin_effects = with(Hook::Margin).map(|(active, entry, first)| ContactEffect {
            hook: T::hooks(entry).margin,
            active,
            first,
        });
        ContactLaws {
            model,
            flat,
            effects: effects.collect(),
            margin_effects: margin_effects.collect(),
            values: BTreeMap::new(),
            margins: RefCell::default(),
        }
    }

    /// Gap between the outlines of two bodies at which they touch (m); 0 at a wall.
    pub fn margin(&self, a: usize, b: usize) -> T {
        if self.margin_effects.is_empty() || b >= self.model.bodies.len() {
            return T::zero();
        }
        let (one, other) = (&self.model.bodies[a], &self.model.bodies[b]);
        let of = |effect: &ContactEffect<MarginFn<T>>| {
            (effect.hook)(&effect.active.values_for(effect.first, self.flat, one, other))
        };
        let sum = || self.margin_effects.iter().fold(T::zero(), |sum, effect| sum + of(effect));
        *self.margins.borrow_mut().entry((a, b)).or_insert_with(sum)
    }

    /// Keeps the parameter values of a pair, which meets now and may meet again.
    pub fn remember(&mut self, a: usize, b: usize) {
        if !self.values.contains_key(&(a, b)) {
            let values = self.values(a, b);
            self.values.insert((a, b), values);
        }
    }

    /// The law of the contact between `a` and `b`, which are these bodies (no second one: a wall).
    pub fn law(
        &self,
        (a, b): (usize, usize),
        bodies: (Body<T>, Option<Body<T>>),
        contact: &ContactGeometry<T>,
    ) -> ContactLaw<T> {
        let ContactGeometry { normal, point, approach } = *contact;
        let contact = Contact { a: bodies.0, b: bodies.1, normal, point, approach };
        let mut law = ContactLaw::plain();
        let values = self.values.get(&(a, b)).map_or_else(|| Cow::Owned(self.values(a, b)), Cow::Borrowed);
        for (effect, [pa, pb]) in self.effects.iter().zip(values.iter()) {
            (effect.hook)(pa, pb, &contact, &mut law);
        }
        law
    }

    /// Parameters of each contact effect as they apply to body `a` when it touches `b`, and the other way round.
    fn values(&self, a: usize, b: usize) -> Vec<[Vec<T>; 2]> {
        let body = |k: usize| self.model.bodies.get(k);
        let values = |effect: &ContactEffect<ContactFn<T>>, i: usize, j: usize| {
            let (Some(this), other) = (body(i).or(body(j)), body(j).or(body(i))) else { return vec![] };
            effect.active.values_for(effect.first, self.flat, this, other.unwrap_or(this))
        };
        self.effects.iter().map(|effect| [values(effect, a, b), values(effect, b, a)]).collect()
    }
}
