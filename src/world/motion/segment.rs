//! Motion of one body without contacts: one Runge-Kutta segment to the end of the step or to the next change of mode.
//!
//! A segment ends early where friction changes its mode ([`Dynamics::next_change`]), since the right-hand side is not smooth
//! there. The change is approached by segments of 90 % of the time left; the last one, up to the change itself, uses the midpoint
//! rule, because the direction of friction is undefined at its end. A segment is halved while the acceleration is so far from
//! linear in time that a third-order position would be wrong by more than [`LINEARITY_TOLERANCE`].

use crate::effects::Scalar;
use crate::num::Real;
use crate::world::motion::dynamics::Dynamics;
use crate::world::motion::ground_friction::{Mode, ModeChange};
use crate::world::motion::kinematics::{Kinematics, Rates, linearity_error};

/// Share of the time to a change of mode that one segment covers, and the time from which one segment covers all of it (s).
pub(in crate::world) const APPROACH_SHARE: f64 = 0.9;
pub(in crate::world) const SHORTEST_APPROACH: f64 = 1e-3;
/// Largest [`linearity_error`] of a segment (m); the error of the fourth-order rule is a small share of it.
pub(in crate::world) const LINEARITY_TOLERANCE: f64 = 3e-6;
/// No segment is halved below this (s).
pub(in crate::world) const SHORTEST_SEGMENT: f64 = 1e-3;
/// Times closer than this count as equal (s): differences of positions over less are rounding errors.
pub(in crate::world) const INSTANT: f64 = 1e-9;

/// Where a segment starts.
#[derive(Clone, Copy)]
pub(in crate::world) struct SegmentStart<T> {
    /// Index of the body.
    pub body: usize,
    pub mode: Mode,
    pub state: Kinematics<T>,
    /// s.
    pub time: T,
}

impl<T: Real> SegmentStart<T> {
    /// The real parts.
    pub fn value(&self) -> SegmentStart<f64> {
        let SegmentStart { body, mode, ref state, time } = *self;
        SegmentStart { body, mode, state: state.value(), time: time.value() }
    }
}

/// Where a segment ends.
pub(in crate::world) struct Segment<T> {
    /// During the segment.
    pub mode: Mode,
    pub end: Kinematics<T>,
    /// s.
    pub end_time: T,
    /// At the end.
    pub change: Option<ModeChange>,
}

impl<T: Scalar> Dynamics<T> {
    /// The motion of a body up to `end` (s) or to its next change of mode.
    pub fn segment(&self, start: &SegmentStart<T>, end: f64) -> Segment<T> {
        let SegmentStart { body: i, state, time, .. } = *start;
        let w = self.wrench(i, &state, time);
        let mode = self.mode_under(i, start.mode, &w);
        let start = SegmentStart { mode, ..*start };
        let mut end_time = T::constant(end);
        if !mode.is_moving() || (end_time - time).value() <= 0.0 {
            return Segment { mode, end: state, end_time, change: None };
        }
        let first = self.rates(i, &state, mode, &w);
        let mut change = None;
        if let Some((kind, after)) = self.next_change(i, &state, mode, &w, &first)
            && (time + after).value() < end
        {
            (end_time, change) = (time + after, Some(kind));
            if after.value() > SHORTEST_APPROACH {
                (end_time, change) = (time + after * APPROACH_SHARE, Some(ModeChange::Continue));
            }
        }
        if change.is_some_and(ModeChange::ends_friction) {
            let end = self.midpoint(&start, &first, end_time - time);
            return Segment { mode, end, end_time, change };
        }
        loop {
            let h = end_time - time;
            let (end, error) = self.runge_kutta(&start, &first, h);
            if error <= LINEARITY_TOLERANCE || h.value() <= SHORTEST_SEGMENT {
                return Segment { mode, end, end_time, change };
            }
            (end_time, change) = (time + h * 0.5, Some(ModeChange::Continue));
        }
    }

    /// The state at `time` (s) within a segment that ends with `change`.
    pub fn state_at(&self, start: &SegmentStart<T>, time: T, change: Option<ModeChange>) -> Kinematics<T> {
        let SegmentStart { body: i, mode, state, time: since } = *start;
        let h = time - since;
        if !mode.is_moving() || h.value() <= 0.0 {
            return state;
        }
        let first = self.rates(i, &state, mode, &self.wrench(i, &state, since));
        if change.is_some_and(ModeChange::ends_friction) {
            return self.midpoint(start, &first, h);
        }
        self.runge_kutta(start, &first, h).0
    }

    /// Accelerations at a stage of a segment.
    fn stage_rates(&self, start: &SegmentStart<T>, k: &Kinematics<T>, time: T) -> Rates<T> {
        self.rates(start.body, k, start.mode, &self.wrench(start.body, k, time))
    }

    /// The midpoint rule over `h` (s); it never evaluates friction at the end, where it has no direction.
    fn midpoint(&self, start: &SegmentStart<T>, k1: &Rates<T>, h: T) -> Kinematics<T> {
        let half = h * 0.5;
        let y2 = start.state.stepped(&start.state, k1, half);
        let k2 = self.stage_rates(start, &y2, start.time + half);
        start.state.stepped(&y2, &k2, h)
    }

    /// The classical fourth-order Runge-Kutta method over `h` (s), and its [`linearity_error`] (m).
    fn runge_kutta(&self, start: &SegmentStart<T>, k1: &Rates<T>, h: T) -> (Kinematics<T>, f64) {
        let (from, since, half) = (&start.state, start.time, h * 0.5);
        let y2 = from.stepped(from, k1, half);
        let k2 = self.stage_rates(start, &y2, since + half);
        let y3 = from.stepped(&y2, &k2, half);
        let k3 = self.stage_rates(start, &y3, since + half);
        let y4 = from.stepped(&y3, &k3, h);
        let k4 = self.stage_rates(start, &y4, since + h);
        let end = from.summed(k1, [(&y2, &k2), (&y3, &k3), (&y4, &k4)], h);
        (end, linearity_error([k1, &k2, &k3, &k4], h.value()))
    }
}
