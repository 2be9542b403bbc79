//! The queue of events in a step, in order of time: changes of mode, impacts and delayed impulses.
//!
//! Each entry predicts an event from the present segments of the bodies that take part. A body has a *generation*, which counts
//! its segments; an entry whose generations differ from the present ones is outdated and is discarded when it comes up (lazy
//! deletion: Lubachevsky, Journal of Computational Physics 94 (1991) 255). A step costs `O(log n)` per event for n entries.

use crate::num::Real;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// What happens next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::world) enum NextEvent {
    /// A change of mode of a body.
    ModeChange(usize),
    /// A body meets a body or wall.
    Impact(usize, usize),
    /// Index among the delayed impulses.
    DelayedImpulse(usize),
}

/// An event that happens unless the segments of its bodies change before.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scheduled {
    /// s.
    time: f64,
    event: NextEvent,
    /// Of the bodies that take part, when this was scheduled.
    generations: (u32, u32),
}

impl Eq for Scheduled {}

impl Ord for Scheduled {
    /// By time; simultaneous events in a fixed order.
    fn cmp(&self, other: &Self) -> Ordering {
        self.time.total_cmp(&other.time).then(self.event.cmp(&other.event))
    }
}

impl PartialOrd for Scheduled {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The impulse of a soft contact between bodies `a` and `b` (or wall `b - bodies`), which acts at `time` (s).
#[derive(Clone, Copy)]
pub(in crate::world) struct DelayedImpulse<T> {
    pub time: T,
    pub a: usize,
    pub b: usize,
}

/// All scheduled events of a step, valid or outdated, and the delayed impulses of all steps.
pub(in crate::world) struct EventQueue<T> {
    scheduled: BinaryHeap<Reverse<Scheduled>>,
    /// How often the segment of each body has changed; walls have none.
    generations: Vec<u32>,
    delayed: Vec<DelayedImpulse<T>>,
}

impl<T: Real> EventQueue<T> {
    pub fn new() -> Self {
        EventQueue { scheduled: BinaryHeap::new(), generations: vec![], delayed: vec![] }
    }

    /// Removes the scheduled events; delayed impulses stay.
    pub fn clear(&mut self, bodies: usize) {
        self.scheduled.clear();
        self.generations.resize(bodies, 0);
    }

    /// The segment of a body has changed: its scheduled events are outdated.
    pub fn outdate(&mut self, body: usize) {
        self.generations[body] += 1;
    }

    fn generations_of(&self, event: NextEvent) -> (u32, u32) {
        let generation = |i: usize| self.generations.get(i).copied().unwrap_or(0);
        match event {
            NextEvent::ModeChange(i) => (generation(i), 0),
            NextEvent::Impact(a, b) => (generation(a), generation(b)),
            NextEvent::DelayedImpulse(_) => (0, 0),
        }
    }

    pub fn schedule(&mut self, time: f64, event: NextEvent) {
        let generations = self.generations_of(event);
        self.scheduled.push(Reverse(Scheduled { time, event, generations }));
    }

    /// The first scheduled event that is still valid.
    fn first(&mut self) -> Option<(f64, NextEvent)> {
        while let Some(Reverse(next)) = self.scheduled.peek() {
            if next.generations == self.generations_of(next.event) {
                return Some((next.time, next.event));
            }
            self.scheduled.pop();
        }
        None
    }

    /// The next event of the step that ends at `step_end` (s).
    pub fn next(&mut self, step_end: f64) -> Option<(f64, NextEvent)> {
        let mut best = self.first();
        for (which, impulse) in self.delayed.iter().enumerate() {
            let time = impulse.time.value();
            if time <= step_end && best.is_none_or(|(first, _)| time < first) {
                best = Some((time, NextEvent::DelayedImpulse(which)));
            }
        }
        best
    }

    pub fn delay(&mut self, impulse: DelayedImpulse<T>) {
        self.delayed.push(impulse);
    }

    pub fn take_delayed(&mut self, which: usize) -> DelayedImpulse<T> {
        self.delayed.swap_remove(which)
    }

    /// Whether an impulse between the two is pending.
    pub fn is_delayed(&self, a: usize, b: usize) -> bool {
        self.delayed.iter().any(|impulse| impulse.a == a && impulse.b == b)
    }
}
