//! The state of one body during a step, and where its present segment leads.

use crate::num::{Real, Vec2};
use crate::scene::Shape;
use crate::world::motion::ground_friction::{Mode, ModeChange};
use crate::world::motion::kinematics::Kinematics;
use crate::world::motion::path::BoundedPath;
use crate::world::motion::segment::SegmentStart;

/// One body: its state at `since`, and the segment that starts there. Only the methods of this file change it.
pub(in crate::world) struct MovingBody<T> {
    mode: Mode,
    state: Kinematics<T>,
    since: T,
    end: Kinematics<T>,
    end_time: T,
    change: Option<ModeChange>,
    path: BoundedPath,
}

/// A body before it moved to an impact.
pub(in crate::world) struct Checkpoint<T> {
    pub body: usize,
    pub start: SegmentStart<T>,
    change: Option<ModeChange>,
}

impl<T: Real> MovingBody<T> {
    /// A body that enters at `time` (s).
    pub fn absent(shape: Shape, state: Kinematics<T>, time: f64) -> Self {
        let still = state.value();
        MovingBody {
            mode: Mode::Absent,
            state,
            since: T::constant(time),
            end: state,
            end_time: T::constant(time),
            change: None,
            path: BoundedPath::new(shape, time, time, still, still),
        }
    }

    #[inline(always)]
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// The state at [`since`](Self::since).
    #[inline(always)]
    pub fn state(&self) -> &Kinematics<T> {
        &self.state
    }

    /// s.
    #[inline(always)]
    pub fn since(&self) -> T {
        self.since
    }

    /// The state at the end of the segment.
    pub fn end(&self) -> &Kinematics<T> {
        &self.end
    }

    /// s.
    pub fn end_time(&self) -> T {
        self.end_time
    }

    /// The change of mode at the end of the segment.
    pub fn change(&self) -> Option<ModeChange> {
        self.change
    }

    pub fn path(&self) -> &BoundedPath {
        &self.path
    }

    pub fn is_absent(&self) -> bool {
        self.mode == Mode::Absent
    }

    pub fn segment_start(&self, body: usize) -> SegmentStart<T> {
        SegmentStart { body, mode: self.mode, state: self.state, time: self.since }
    }

    pub fn set_mode(&mut self, mode: Mode) {
        self.mode = mode;
    }

    pub fn set_state(&mut self, state: Kinematics<T>) {
        self.state = state;
    }

    /// A new step starts at `time` (s), with the state as it is.
    pub fn set_time(&mut self, time: T) {
        self.since = time;
    }

    /// The body has moved to `time` (s) within its segment, which is no longer valid.
    pub fn arrive_at(&mut self, time: T) {
        (self.since, self.change) = (time, None);
    }

    /// Moves the body to the end of its segment.
    pub fn arrive(&mut self) {
        (self.state, self.since) = (self.end, self.end_time);
    }

    pub fn take_change(&mut self) -> Option<ModeChange> {
        self.change.take()
    }

    /// The segment that starts at the present state.
    pub fn set_segment(&mut self, shape: Shape, end: Kinematics<T>, end_time: T, change: Option<ModeChange>) {
        (self.end, self.end_time, self.change) = (end, end_time, change);
        let (start, state) = (self.since.value(), self.state.value());
        self.path = BoundedPath::new(shape, start, end_time.value(), state, end.value());
    }

    /// Dry friction holds the body from now on.
    pub fn come_to_rest(&mut self) {
        self.mode = Mode::Rest;
        self.state.velocity = Vec2::zero();
        self.state.spin = T::zero();
        self.state.roll = Vec2::zero();
    }

    pub fn checkpoint(&self, body: usize) -> Checkpoint<T> {
        Checkpoint { body, start: self.segment_start(body), change: self.change }
    }

    /// Back to an earlier state; the mode stays.
    pub fn restore(&mut self, saved: &Checkpoint<T>) {
        (self.state, self.since, self.change) = (saved.start.state, saved.start.time, saved.change);
    }
}
