//! Records of a simulation: states at the requested times, and events.

use crate::effects::Scalar;
use crate::num::Vec2;
use crate::world::contact::compression::Compression;
use crate::world::motion::kinematics::{Kinematics, Rates};
use crate::world::motion::segment::{INSTANT, SegmentStart};
use crate::world::trace::{Event, EventKind};

/// Impulses between one pair, or stops of one body, within this time (s) are recorded as one event.
const SAME_EVENT: f64 = 0.1;

/// `[time][body]`; `None` before a body enters.
pub(in crate::world) type RecordedStates<T> = Vec<Vec<Option<Kinematics<T>>>>;

/// States at the requested times and the events so far.
pub(in crate::world) struct Recorder<'m, T> {
    /// s.
    times: &'m [f64],
    states: RecordedStates<T>,
    /// For each body, index of the next requested time.
    next: Vec<usize>,
    events: Vec<Event>,
    compressions: Vec<Compression<T>>,
}

impl<'m, T: Scalar> Recorder<'m, T> {
    pub fn new(times: &'m [f64], bodies: usize) -> Self {
        let states = times.iter().map(|_| (0..bodies).map(|_| None).collect()).collect();
        Recorder { times, states, next: vec![0; bodies], events: vec![], compressions: vec![] }
    }

    /// A body enters at `time` (s): it has no states before.
    pub fn enter(&mut self, body: usize, time: f64) {
        self.next[body] = self.times.partition_point(|&t| t < time);
    }

    /// Records the requested states of a body from the start of a segment to `end` at `end_time` (s).
    pub fn record(&mut self, start: &SegmentStart<T>, end: &Kinematics<T>, end_time: T) {
        let SegmentStart { body, mode, ref state, time: since } = *start;
        let next = &mut self.next[body];
        while let Some(&time) = self.times.get(*next).filter(|&&t| t <= end_time.value()) {
            self.states[*next][body] = Some(match mode.is_moving() {
                true if (end_time - since).value() > INSTANT => state.between(since, end, end_time, time),
                true => end.stepped(end, &Rates::zero(), -end_time + time),
                false => *end,
            });
            *next += 1;
        }
    }

    /// Records that an object stops at `position` (m). An earlier stop within [`SAME_EVENT`] is replaced.
    pub fn record_stop(&mut self, id: u32, time: f64, position: Vec2) {
        let objects = vec![id];
        let recent = self.events.iter().rev().take_while(|e| time - e.time < SAME_EVENT);
        let same = |e: &Event| e.kind == EventKind::Stop && e.objects == objects;
        if let Some(back) = recent.map(same).position(|same| same) {
            self.events.remove(self.events.len() - 1 - back);
        }
        let kind = EventKind::Stop;
        self.events.push(Event { kind, time, objects, position, normal: None, impulse: None, wall: None });
    }

    /// Records a collision. Its impulse is added to an earlier collision of the same pair within [`SAME_EVENT`].
    pub fn record_collision(&mut self, collision: Event) {
        let earlier = self.events.iter_mut().rev().take_while(|e| e.time > collision.time - SAME_EVENT);
        let same = earlier
            .filter(|e| e.kind == EventKind::Collision)
            .find(|e| e.objects == collision.objects && e.wall == collision.wall);
        match (same, collision.impulse) {
            (Some(event), Some(impulse)) => event.impulse = event.impulse.map(|j| j + impulse),
            _ => self.events.push(collision),
        }
    }

    /// Records that a soft contact begins.
    pub fn record_compression(&mut self, contact: Compression<T>) {
        self.compressions.push(contact);
    }

    /// The last soft contact of these two has given no impulse.
    pub fn remove_compression(&mut self, a: usize, b: usize) {
        if let Some(last) = self.compressions.iter().rposition(|c| (c.a, c.b) == (a, b)) {
            self.compressions.remove(last);
        }
    }

    /// States and events.
    pub fn finish(mut self) -> (RecordedStates<T>, Vec<Event>) {
        for contact in &self.compressions {
            let (first, last) = (contact.since.value(), (contact.since + contact.duration).value());
            let frames =
                self.times.partition_point(|&t| t <= first)..self.times.partition_point(|&t| t < last);
            for frame in frames {
                for body in [contact.a, contact.b] {
                    if let Some(k) = self.states[frame].get_mut(body).and_then(Option::as_mut) {
                        contact.apply(self.times[frame], body, k);
                    }
                }
            }
        }
        (self.states, self.events)
    }
}
