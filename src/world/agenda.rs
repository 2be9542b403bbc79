//! What happens next in a step: changes, impacts and blows in order of time.

use super::impact::{Path, time_of_impact};
use super::motion::Mode;
use super::simulate::{Few, Run};
use crate::effects::Scalar;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// What comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Next {
    /// Of the motion of a body.
    Change(usize),
    /// Of a body on a body or wall.
    Impact(usize, usize),
    /// Index among the blows.
    Blow(usize),
}

/// Something that will happen unless the ways of those who take part change before.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Due {
    time: f64,
    next: Next,
    /// How often their ways had changed when this was found.
    ways: (u32, u32),
}

impl Eq for Due {}

impl Ord for Due {
    /// By time; what happens at once in a fixed order.
    fn cmp(&self, other: &Self) -> Ordering {
        self.time.total_cmp(&other.time).then(self.next.cmp(&other.next))
    }
}

impl PartialOrd for Due {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// All that is due in a step, out of date or not.
#[derive(Default)]
pub(super) struct Agenda {
    due: BinaryHeap<Reverse<Due>>,
    /// How often the way of each body has changed; walls stay.
    ways: Vec<u32>,
}

impl Agenda {
    fn clear(&mut self, bodies: usize) {
        self.due.clear();
        self.ways.resize(bodies, 0);
    }

    fn now(&self, next: Next) -> (u32, u32) {
        let way = |i: usize| self.ways.get(i).copied().unwrap_or(0);
        match next {
            Next::Change(i) => (way(i), 0),
            Next::Impact(a, b) => (way(a), way(b)),
            Next::Blow(_) => (0, 0),
        }
    }

    fn add(&mut self, time: f64, next: Next) {
        self.due.push(Reverse(Due { time, next, ways: self.now(next) }));
    }

    /// The first that still holds.
    fn first(&mut self) -> Option<(f64, Next)> {
        while let Some(Reverse(due)) = self.due.peek() {
            if due.ways == self.now(due.next) {
                return Some((due.time, due.next));
            }
            self.due.pop();
        }
        None
    }
}

impl<T: Scalar> Run<'_, T> {
    /// All that is due in the step, from the ways that bodies go.
    pub(super) fn plan(&mut self) {
        self.grid.fill(self.bodies.iter().map(|b| (b.path.low, b.path.high)));
        self.agenda.clear(self.bodies.len());
        for i in 0..self.bodies.len() {
            self.plan_change(i);
            self.plan_impacts(i, |j| j > i);
        }
    }

    /// What is due anew for bodies whose ways have changed.
    pub(super) fn refresh(&mut self, changed: &[usize]) {
        for &i in changed {
            self.agenda.ways[i] += 1;
            let Path { low, high, .. } = self.bodies[i].path;
            self.grid.update(i, low, high);
        }
        for &i in changed {
            self.plan_change(i);
            self.plan_impacts(i, |j| !(changed.contains(&j) && j < i));
        }
    }

    fn plan_change(&mut self, i: usize) {
        if self.bodies[i].change.is_some() {
            self.agenda.add(self.bodies[i].until.value(), Next::Change(i));
        }
    }

    fn plan_impacts(&mut self, i: usize, wanted: impl Fn(usize) -> bool) {
        if self.bodies[i].mode == Mode::Absent {
            return;
        }
        let met = |j: usize| Some((self.impact_of(i.min(j), i.max(j))?, j));
        let others = |j: &usize| *j != i && wanted(*j);
        let (bodies, walls) = (self.bodies.len(), self.walls.len());
        let found: Few<(f64, usize)> = match self.grid.near(i) {
            Some(near) => {
                near.into_iter().chain(bodies..bodies + walls).filter(others).filter_map(met).collect()
            }
            None => (0..bodies + walls).filter(others).filter_map(met).collect(),
        };
        for (time, j) in found {
            self.agenda.add(time, Next::Impact(i.min(j), i.max(j)));
        }
    }

    /// When body `a` will run into body or wall `b`.
    fn impact_of(&self, a: usize, b: usize) -> Option<f64> {
        let body = &self.bodies[a];
        let still = |mode: Mode| matches!(mode, Mode::Rest | Mode::Absent);
        let of_wall;
        let other = match self.bodies.get(b) {
            Some(o) if o.mode == Mode::Absent || (still(o.mode) && still(body.mode)) => return None,
            Some(o) => &o.path,
            None if still(body.mode) => return None,
            None => {
                let wall = &self.walls[b - self.bodies.len()];
                let still = wall.place.value();
                of_wall = Path::new(wall.shape, body.path.start, body.path.end, still, still);
                &of_wall
            }
        };
        if body.mode == Mode::Absent || !body.path.overlaps(other) || self.engaged(a, b) {
            return None;
        }
        let (from, to) = (body.path.start.max(other.start), body.path.end.min(other.end));
        if from >= to {
            return None;
        }
        time_of_impact(&body.path, other, self.margin(a, b).value(), from, to)
    }

    /// Whether the two are in contact, so that they cannot run into each other.
    fn engaged(&self, a: usize, b: usize) -> bool {
        // Bodies in contact are in one group.
        let joined = b >= self.bodies.len() || self.bodies[a].group.contains(&b);
        (joined && self.touching.iter().any(|t| t.a == a && t.b == b))
            || self.passing.contains(&(a, b))
            || self.blows.iter().any(|blow| blow.a == a && blow.b == b)
            || (joined && self.one_body(a, b))
    }

    pub(super) fn next_event(&mut self) -> Option<(f64, Next)> {
        let mut best = self.agenda.first();
        for (which, blow) in self.blows.iter().enumerate() {
            let time = blow.time.value();
            if time <= self.step_end && best.is_none_or(|(first, _)| time < first) {
                best = Some((time, Next::Blow(which)));
            }
        }
        best
    }
}
