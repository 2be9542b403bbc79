//! Undisturbed motion of one body: one stretch of Runge-Kutta to the end of the step or the next change of mode.

use super::motion::{Change, Kinematics, Laws, Mode, Rates};
use crate::effects::Scalar;

/// A change of mode is approached in stretches of this share of the time left, down to the shortest (s).
pub(super) const APPROACH_SHARE: f64 = 0.9;
pub(super) const SHORTEST_APPROACH: f64 = 1e-3;
/// A stretch is halved while its acceleration is so uneven that positions would be off by this (m) had it been linear, down to
/// the shortest (s); a rule of fourth order leaves a small share of it.
pub(super) const ROUGH: f64 = 3e-6;
pub(super) const SHORTEST_STRETCH: f64 = 1e-3;
/// No time at all (s): over less, differences of places are rounding.
pub(super) const INSTANT: f64 = 1e-9;

/// Where a stretch leads.
pub(super) struct Flight<T> {
    pub mode: Mode,
    pub to: Kinematics<T>,
    pub until: T,
    pub change: Option<Change>,
}

impl<T: Scalar> Laws<T> {
    /// The motion of body `i` from `since` to `end` (s) or to its next change of mode.
    pub fn flight(&self, i: usize, from: &Kinematics<T>, mode: Mode, since: T, end: f64) -> Flight<T> {
        let w = self.wrench(i, from, since);
        let mode = self.mode_under(i, mode, &w);
        let mut until = T::constant(end);
        if matches!(mode, Mode::Rest | Mode::Absent) || (until - since).value() <= 0.0 {
            return Flight { mode, to: *from, until, change: None };
        }
        let first = self.rates(i, from, mode, &w);
        let mut change = None;
        if let Some((kind, after)) = self.next_change(i, from, mode, &w, &first)
            && (since + after).value() < end
        {
            (until, change) = (since + after, Some(kind));
            if after.value() > SHORTEST_APPROACH {
                (until, change) = (since + after * APPROACH_SHARE, Some(Change::Continue));
            }
        }
        if change.is_some_and(|c| c != Change::Continue) {
            let to = self.midpoint(i, from, &first, mode, since, until - since);
            return Flight { mode, to, until, change };
        }
        loop {
            let h = until - since;
            let (to, unevenness) = self.runge_kutta(i, from, &first, mode, since, h);
            if unevenness <= ROUGH || h.value() <= SHORTEST_STRETCH {
                return Flight { mode, to, until, change };
            }
            (until, change) = (since + h * 0.5, Some(Change::Continue));
        }
    }

    /// The state of body `i` at `time`, on the way of a stretch that ends with `change`.
    pub fn moved(
        &self,
        i: usize,
        from: &Kinematics<T>,
        mode: Mode,
        since: T,
        time: T,
        change: Option<Change>,
    ) -> Kinematics<T> {
        let h = time - since;
        if matches!(mode, Mode::Rest | Mode::Absent) || h.value() <= 0.0 {
            return *from;
        }
        let first = self.rates(i, from, mode, &self.wrench(i, from, since));
        if change.is_some_and(|c| c != Change::Continue) {
            return self.midpoint(i, from, &first, mode, since, h);
        }
        self.runge_kutta(i, from, &first, mode, since, h).0
    }

    /// The midpoint rule, for the way to a change of mode: friction has no direction at its end, and the
    /// midpoint never looks there.
    fn midpoint(
        &self,
        i: usize,
        from: &Kinematics<T>,
        k1: &Rates<T>,
        mode: Mode,
        since: T,
        h: T,
    ) -> Kinematics<T> {
        let half = h * 0.5;
        let y2 = from.stepped(from, k1, half);
        let k2 = self.rates(i, &y2, mode, &self.wrench(i, &y2, since + half));
        from.stepped(&y2, &k2, h)
    }

    /// Fourth-order Runge-Kutta, and how far the positions would be off had the acceleration been linear (m).
    fn runge_kutta(
        &self,
        i: usize,
        from: &Kinematics<T>,
        k1: &Rates<T>,
        mode: Mode,
        since: T,
        h: T,
    ) -> (Kinematics<T>, f64) {
        let rates = |k: &Kinematics<T>, time: T| self.rates(i, k, mode, &self.wrench(i, k, time));
        let half = h * 0.5;
        let y2 = from.stepped(from, k1, half);
        let k2 = rates(&y2, since + half);
        let y3 = from.stepped(&y2, &k2, half);
        let k3 = rates(&y3, since + half);
        let y4 = from.stepped(&y3, &k3, h);
        let k4 = rates(&y4, since + h);
        let to = from.summed(k1, [(&y2, &k2), (&y3, &k3), (&y4, &k4)], h);
        (to, bend([k1, &k2, &k3, &k4], h.value()))
    }
}

/// How far positions would be off after `h` (s) had the acceleration been linear (m), by the rates of four stages.
pub(super) fn bend<T: Scalar>(stages: [&Rates<T>; 4], h: f64) -> f64 {
    let [k1, k2, k3, k4] = stages.map(|k| k.velocity.value());
    (k1 - k2 - k3 + k4).norm() * h * h / 12.0
}
