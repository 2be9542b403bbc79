//! Scheduling: the events that follow from the present segments of the bodies.

use crate::effects::Scalar;
use crate::world::contact::time_of_impact::time_of_impact;
use crate::world::motion::ground_friction::Mode;
use crate::world::motion::kinematics::IslandVec;
use crate::world::motion::path::BoundedPath;
use crate::world::simulation::event_queue::NextEvent;
use crate::world::simulation::state::Simulation;

impl<T: Scalar> Simulation<'_, T> {
    /// Schedules all events of the step.
    pub(in crate::world) fn schedule_all(&mut self) {
        self.grid.fill(self.bodies.iter().map(|b| (b.path().low, b.path().high)));
        self.queue.clear(self.bodies.len());
        for i in 0..self.bodies.len() {
            self.schedule_change(i);
            self.schedule_impacts(i, |j| j > i);
        }
    }

    /// Schedules the events of bodies whose segments have changed; their earlier events are outdated.
    pub(in crate::world) fn reschedule(&mut self, changed: &[usize]) {
        for &i in changed {
            self.queue.outdate(i);
            let path = self.bodies[i].path();
            self.grid.update(i, path.low, path.high);
        }
        for &i in changed {
            self.schedule_change(i);
            self.schedule_impacts(i, |j| !(changed.contains(&j) && j < i));
        }
    }

    fn schedule_change(&mut self, i: usize) {
        let body = &self.bodies[i];
        if body.change().is_some() {
            self.queue.schedule(body.end_time().value(), NextEvent::ModeChange(i));
        }
    }

    fn schedule_impacts(&mut self, i: usize, wanted: impl Fn(usize) -> bool) {
        if self.bodies[i].is_absent() {
            return;
        }
        let impact = |j: usize| Some((self.next_impact(i.min(j), i.max(j))?, j));
        let others = |j: &usize| *j != i && wanted(*j);
        let (bodies, walls) = (self.bodies.len(), self.walls.len());
        let found: IslandVec<(f64, usize)> = match self.grid.near(i) {
            Some(near) => {
                near.into_iter().chain(bodies..bodies + walls).filter(others).filter_map(impact).collect()
            }
            None => (0..bodies + walls).filter(others).filter_map(impact).collect(),
        };
        for (time, j) in found {
            self.queue.schedule(time, NextEvent::Impact(i.min(j), i.max(j)));
        }
    }

    /// When body `a` will collide with body or wall `b` (s).
    fn next_impact(&self, a: usize, b: usize) -> Option<f64> {
        let body = &self.bodies[a];
        let path = body.path();
        let still = |mode: Mode| !mode.is_moving();
        let of_wall;
        let other = match self.bodies.get(b) {
            Some(o) if o.is_absent() || (still(o.mode()) && still(body.mode())) => return None,
            Some(o) => o.path(),
            None if still(body.mode()) => return None,
            None => {
                let wall = &self.walls[b - self.bodies.len()];
                let state = wall.state.value();
                of_wall = BoundedPath::new(wall.shape, path.start, path.end, state, state);
                &of_wall
            }
        };
        if body.is_absent() || !path.overlaps(other) || self.are_engaged(a, b) {
            return None;
        }
        let (from, to) = (path.start.max(other.start), path.end.min(other.end));
        if from >= to {
            return None;
        }
        time_of_impact(path, other, self.contact_laws.margin(a, b).value(), from, to)
    }

    /// Whether the two are in contact already, so that they cannot collide.
    fn are_engaged(&self, a: usize, b: usize) -> bool {
        // Bodies in contact are in one island.
        let joined = b >= self.bodies.len() || self.islands.same(a, b);
        (joined && self.contacts.contains(a, b))
            || self.contacts.is_passing(a, b)
            || self.queue.is_delayed(a, b)
            || (joined && self.bonds.same_cluster(a, b))
    }
}
