//! Contacts that last while bodies press on each other, and the obstacles that bodies pass through.
//!
//! A contact becomes persistent where an impact leaves a separation speed near zero. Its points then carry the forces that
//! [`contact_solver`](super::contact_solver) finds at each stage of the integration, so that the gap stays closed. At the start
//! of each segment the contacts without a pressing force are marked, and they are released when the segment ends. The forces
//! found last are the start of the next solution (warm start).

use crate::body::ContactLaw;
use crate::num::Real;

/// A contact that lasts: bodies `a` and `b` (or wall `b - bodies`) press on each other.
#[derive(Clone, Copy)]
pub(in crate::world) struct PersistentContact<T> {
    pub a: usize,
    pub b: usize,
    /// Whether the solver found a pressing force; otherwise it is released.
    pub pressing: bool,
    /// Whether its forces hold bodies in static equilibrium.
    pub in_equilibrium: bool,
    /// Coulomb coefficient between the two.
    pub friction: T,
    /// Share of a ball's roll that contact friction ignores.
    pub ignore_roll: T,
    /// At each end of the edge, the forces with which the next solution starts.
    pub warm_start: [WarmStart; 2],
}

/// Forces that the solver found last at one point.
#[derive(Clone, Copy)]
pub(in crate::world) struct WarmStart {
    /// N.
    pub normal_force: f64,
    pub tangential_force: f64,
    /// Whether friction was at its bound.
    pub slides: bool,
}

impl<T: Real> PersistentContact<T> {
    pub fn new(a: usize, b: usize, law: &ContactLaw<T>) -> Self {
        let &ContactLaw { friction, ignore_roll, .. } = law;
        let warm_start = [WarmStart { normal_force: 0.0, tangential_force: 0.0, slides: true }; 2];
        PersistentContact { a, b, pressing: true, in_equilibrium: false, friction, ignore_roll, warm_start }
    }

    pub fn involves(&self, body: usize) -> bool {
        self.a == body || self.b == body
    }
}

/// The persistent contacts of a simulation. Only the methods of this file change them.
pub(in crate::world) struct ContactSet<T> {
    contacts: Vec<PersistentContact<T>>,
    /// Bodies inside an obstacle that lets them through.
    passing: Vec<(usize, usize)>,
}

impl<T: Real> ContactSet<T> {
    pub fn new() -> Self {
        ContactSet { contacts: vec![], passing: vec![] }
    }

    pub fn all(&self) -> &[PersistentContact<T>] {
        &self.contacts
    }

    pub fn contains(&self, a: usize, b: usize) -> bool {
        self.contacts.iter().any(|c| c.a == a && c.b == b)
    }

    pub fn any_of(&self, body: usize) -> bool {
        self.contacts.iter().any(|c| c.involves(body))
    }

    /// Whether bodies of the island are in contact.
    pub fn any_within(&self, island: &[usize]) -> bool {
        self.contacts.iter().any(|c| island.contains(&c.a))
    }

    pub fn add(&mut self, contact: PersistentContact<T>) {
        self.contacts.push(contact);
    }

    /// Removes the contacts that `keep` rejects; whether there were any.
    pub fn retain(&mut self, keep: impl Fn(&PersistentContact<T>) -> bool) -> bool {
        let before = self.contacts.len();
        self.contacts.retain(keep);
        self.contacts.len() < before
    }

    pub fn set_pressing(&mut self, contact: usize, pressing: bool) {
        self.contacts[contact].pressing = pressing;
    }

    pub fn set_in_equilibrium(&mut self, contact: usize, in_equilibrium: bool) {
        self.contacts[contact].in_equilibrium = in_equilibrium;
    }

    /// Stores the forces with which the next solution starts.
    pub fn set_warm_start(&mut self, contact: usize, end: usize, start: WarmStart) {
        self.contacts[contact].warm_start[end] = start;
    }

    /// Forgets what has changed since these were copied from [`all`](Self::all).
    pub fn restore(&mut self, contacts: Vec<PersistentContact<T>>) {
        self.contacts = contacts;
    }

    /// Body `a` passes through obstacle `b`.
    pub fn pass(&mut self, a: usize, b: usize) {
        self.passing.push((a, b));
    }

    pub fn is_passing(&self, a: usize, b: usize) -> bool {
        self.passing.contains(&(a, b))
    }

    /// Keeps the pairs that are still inside their obstacle.
    pub fn retain_passing(&mut self, is_inside: impl Fn(usize, usize) -> bool) {
        self.passing.retain(|&(a, b)| is_inside(a, b));
    }
}
