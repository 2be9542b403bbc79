//! Which bodies form islands at present, from contacts, bonds and pair forces.

use crate::effects::Scalar;
use crate::world::contact::time_of_impact::facing;
use crate::world::simulation::state::Simulation;

impl<T: Scalar> Simulation<'_, T> {
    /// Finds the islands at the start of a step; released contacts are removed.
    pub(in crate::world) fn find_islands(&mut self) {
        self.contacts.retain(|c| c.pressing);
        self.leave_obstacles();
        self.islands.separate(0..self.bodies.len());
        if self.dynamics.has_pair_forces() {
            let all: Vec<usize> = (0..self.bodies.len()).filter(|&i| !self.bodies[i].is_absent()).collect();
            return self.islands.unite(&all);
        }
        self.join_contacts();
    }

    /// A body that has left an obstacle can collide with it again.
    fn leave_obstacles(&mut self) {
        let (bodies, walls, dynamics) = (&self.bodies, &self.walls, &self.dynamics);
        self.contacts.retain_passing(|a, b| {
            let wall = &walls[b - bodies.len()];
            let (near, rate) = facing(bodies[a].state(), &dynamics.shapes[a], &wall.state, &wall.shape);
            near.gap.value() <= 0.0 || rate.value() < 0.0
        });
    }

    fn join_contacts(&mut self) {
        for contact in self.contacts.all() {
            self.islands.join(contact.a, contact.b);
        }
        for bond in self.bonds.iter() {
            self.islands.join(bond.a, bond.b);
        }
    }

    /// Removes the released contacts of an island, and splits it if there are any.
    pub(in crate::world) fn release(&mut self, island: &[usize]) {
        if self.contacts.retain(|c| c.pressing || !island.contains(&c.a)) {
            self.split(island);
        }
    }

    /// Finds the islands among these bodies, whose contacts have changed.
    pub(in crate::world) fn split(&mut self, island: &[usize]) {
        if self.dynamics.has_pair_forces() {
            return;
        }
        self.islands.separate(island.iter().copied());
        self.join_contacts();
    }
}
