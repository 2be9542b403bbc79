//! Which traces may be removed: the limits on age and size, their ages, and the leases on traces in use.
//!
//! Invariants:
//! * A step of the wall clock expires nothing that is young: a trace of this process is aged by the monotonic clock. One of
//!   an earlier process is aged by the wall clock, once that has run for [`CLOCK_TRUST`] without a step.
//! * A trace with a [`Lease`] (it is being written, downloaded or replayed) is never removed.
//! * A trace that is being removed gets no lease; a writer of the same trace waits until the removal is done.
//! * Leases are keyed by the whole key in the store, so that tenants do not block each other.

use crate::store::now_ms;
use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::Notify;

/// How long the wall clock must run without a step before it ages traces of earlier processes: a clock that is wrong at the
/// start of a machine is set by then.
const CLOCK_TRUST: Duration = Duration::from_secs(3600);
/// The smallest difference between the two clocks that is a step.
const CLOCK_STEP_MS: u64 = 60_000;

/// Limits on what is kept; by default everything is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Retention {
    /// Traces that were stored longer ago are removed.
    pub max_age: Option<Duration>,
    /// Bytes of all traces of one tenant.
    pub max_bytes: Option<u64>,
}

/// The limits and the leases of all traces.
#[derive(Default)]
pub struct TraceRetention {
    pub limits: Retention,
    /// Notified when traces were stored.
    pub stored: Notify,
    uses: Uses,
    ages: Mutex<TraceAges>,
    /// A file may be left without a record.
    has_orphans: AtomicBool,
}

/// Both clocks at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClockReading {
    /// Milliseconds after 1970.
    pub wall_ms: u64,
    pub monotonic: Instant,
}

impl ClockReading {
    pub fn now() -> ClockReading {
        ClockReading { wall_ms: now_ms(), monotonic: Instant::now() }
    }

    /// Both clocks so much later.
    pub fn after(self, time: Duration) -> ClockReading {
        let wall_ms = self.wall_ms.saturating_add(time.as_millis() as u64);
        ClockReading { wall_ms, monotonic: self.monotonic + time }
    }
}

/// What is known of the ages of traces.
struct TraceAges {
    last: ClockReading,
    steady_since: Instant,
    /// When this process stored a trace, by a digest of its whole key.
    stored: HashMap<u128, Instant>,
}

impl Default for TraceAges {
    fn default() -> Self {
        let last = ClockReading::now();
        TraceAges { last, steady_since: last.monotonic, stored: HashMap::new() }
    }
}

impl TraceAges {
    /// Looks at the clocks; a step starts the time of trust again.
    fn observe(&mut self, now: ClockReading) {
        let passed = now.monotonic.saturating_duration_since(self.last.monotonic).as_millis() as u64;
        let expected = self.last.wall_ms.saturating_add(passed);
        if expected.abs_diff(now.wall_ms) > CLOCK_STEP_MS {
            tracing::warn!(expected, found = now.wall_ms, "the wall clock was set (ms after 1970)");
            self.steady_since = now.monotonic;
        }
        self.last = now;
    }

    /// The age of a trace; `None`: nobody knows it yet.
    fn age(&self, key: &str, stored_ms: u64) -> Option<Duration> {
        if let Some(stored) = self.stored.get(&short_digest(key)) {
            return Some(self.last.monotonic.saturating_duration_since(*stored));
        }
        let steady = self.last.monotonic.saturating_duration_since(self.steady_since);
        (steady >= CLOCK_TRUST).then(|| Duration::from_millis(self.last.wall_ms.saturating_sub(stored_ms)))
    }
}

fn short_digest(key: &str) -> u128 {
    let [digest, _] = *blake3::hash(key.as_bytes()).as_bytes().as_chunks::<16>().0 else { return 0 };
    u128::from_le_bytes(digest)
}

/// By whole key of a trace: how many leases it has, or [`REMOVED`] while it is being removed.
type Uses = Arc<Mutex<HashMap<String, usize>>>;
const REMOVED: usize = usize::MAX;

/// Protects one trace from removal until it is dropped.
pub struct Lease {
    key: String,
    uses: Uses,
}

impl Drop for Lease {
    fn drop(&mut self) {
        let mut uses = locked(&self.uses);
        match uses.get_mut(&self.key) {
            Some(count) if *count > 1 && *count != REMOVED => *count -= 1,
            _ => {
                uses.remove(&self.key);
            }
        }
    }
}

impl TraceRetention {
    pub fn new(limits: Retention) -> TraceRetention {
        TraceRetention { limits, ..TraceRetention::default() }
    }

    /// Notes that a trace was stored now, by its whole key.
    pub fn note_stored(&self, key: &str) {
        if self.limits.max_age.is_some() {
            locked(&self.ages).stored.insert(short_digest(key), Instant::now());
        }
    }

    /// Forgets when traces were stored that are not among these: they were deleted with their videos. The time of one that
    /// was stored after `since` is kept, as whoever looked for them may not have seen it.
    pub fn keep_ages<'k>(&self, keys: impl Iterator<Item = &'k str>, since: Instant) {
        if self.limits.max_age.is_some() {
            let known: HashSet<u128> = keys.map(short_digest).collect();
            locked(&self.ages).stored.retain(|key, stored| *stored >= since || known.contains(key));
        }
    }

    /// Notes that a trace is gone.
    pub fn note_removed(&self, key: &str) {
        locked(&self.ages).stored.remove(&short_digest(key));
    }

    /// Looks at the clocks.
    pub fn observe(&self, now: ClockReading) {
        locked(&self.ages).observe(now);
    }

    /// Whether a trace is older than allowed, by the clocks as they were last looked at.
    pub fn is_too_old(&self, key: &str, stored_ms: u64) -> bool {
        let Some(most) = self.limits.max_age else { return false };
        locked(&self.ages).age(key, stored_ms).is_some_and(|age| age > most)
    }

    /// Asks for a search for files without records soon.
    pub fn look_for_orphans(&self) {
        self.has_orphans.store(true, Ordering::SeqCst);
    }

    /// Whether such a search was asked for; it is then no more.
    pub fn take_orphans(&self) -> bool {
        self.has_orphans.swap(false, Ordering::SeqCst)
    }

    /// A lease; `None` while the trace is being removed.
    pub fn lease(&self, key: &str) -> Option<Lease> {
        let mut uses = locked(&self.uses);
        let count = uses.entry(key.to_string()).or_default();
        if *count == REMOVED {
            return None;
        }
        *count += 1;
        Some(Lease { key: key.to_string(), uses: self.uses.clone() })
    }

    /// A lease, after waiting for a removal of the same trace to end.
    pub async fn lease_when_free(&self, key: &str) -> Lease {
        loop {
            if let Some(lease) = self.lease(key) {
                return lease;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }

    /// The right to remove the trace; `None` if it has a lease.
    pub fn removal(&self, key: &str) -> Option<Lease> {
        let mut uses = locked(&self.uses);
        if uses.contains_key(key) {
            return None;
        }
        uses.insert(key.to_string(), REMOVED);
        Some(Lease { key: key.to_string(), uses: self.uses.clone() })
    }
}

/// No code panics while it holds this lock.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: Duration = Duration::from_secs(86_400);

    #[test]
    fn a_step_of_the_clock_expires_nothing_that_is_young() {
        let limits = Retention { max_age: Some(DAY), max_bytes: None };
        let start = ClockReading::now();
        for step in [365 * DAY.as_millis() as u64, 0] {
            let retention = TraceRetention::new(limits);
            retention.note_stored("new");
            // A year forward, or back to 1970.
            let wall_ms = if step == 0 { 0 } else { start.wall_ms + step };
            let now = ClockReading { wall_ms, ..start.after(Duration::from_secs(2 * 3600)) };
            retention.observe(now);
            assert!(!retention.is_too_old("new", start.wall_ms), "two hours old");
            assert!(!retention.is_too_old("old", start.wall_ms), "the clock was just set");
            retention.observe(now.after(Duration::from_secs(3601)));
            assert!(!retention.is_too_old("new", start.wall_ms), "three hours old");
            assert_eq!(retention.is_too_old("old", start.wall_ms), step > 0, "the clock is believable now");
            retention.observe(now.after(DAY));
            assert!(retention.is_too_old("new", now.wall_ms), "a day by the monotonic clock");
            retention.note_removed("new");
            assert!(!retention.is_too_old("new", now.after(DAY).wall_ms));
        }
    }

    #[test]
    fn times_of_deleted_traces_are_forgotten() {
        let retention = TraceRetention::new(Retention { max_age: Some(DAY), max_bytes: None });
        for key in ["kept", "deleted"] {
            retention.note_stored(key);
        }
        let since = Instant::now();
        retention.note_stored("new");
        retention.keep_ages(["kept"].into_iter(), since);
        let ages = locked(&retention.ages);
        let known = ["kept", "deleted", "new"].map(|key| ages.stored.contains_key(&short_digest(key)));
        assert_eq!(known, [true, false, true]);
    }

    #[test]
    fn a_steady_clock_ages_traces_of_earlier_processes_after_an_hour() {
        let retention = TraceRetention::new(Retention { max_age: Some(DAY), max_bytes: None });
        let start = ClockReading::now();
        let stored_ms = start.wall_ms - 2 * DAY.as_millis() as u64;
        for (minutes, is_too_old) in [(1, false), (59, false), (61, true), (90, true)] {
            retention.observe(start.after(Duration::from_secs(60 * minutes)));
            assert_eq!(retention.is_too_old("old", stored_ms), is_too_old, "after {minutes} minutes");
        }
    }
}
