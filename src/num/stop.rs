//! Progress and cancellation of long work.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Asks whether to go on: long work calls it once an iteration with its progress in 0..=1.
pub type Stop<'a> = &'a (dyn Fn(f64) -> Result<(), Stopped> + Sync);

/// A [`Stop`] for work that is the part from `from` to `to` of the whole.
pub fn progress_within<'s>(
    stop: Stop<'s>,
    [from, to]: [f64; 2],
) -> impl Fn(f64) -> Result<(), Stopped> + Sync + 's {
    move |progress| stop(from + (to - from) * progress.clamp(0.0, 1.0))
}

/// The same for a part of about `pieces` jobs, each of which reports its own progress up to 1.
pub fn progress_of_jobs<'s>(
    stop: Stop<'s>,
    [from, to]: [f64; 2],
    pieces: usize,
) -> impl Fn(f64) -> Result<(), Stopped> + Sync + 's {
    let done = AtomicUsize::new(0);
    move |progress| {
        let ended = usize::from(progress >= 1.0);
        let share = (done.fetch_add(ended, Ordering::Relaxed) + ended) as f64 / pieces.max(1) as f64;
        stop(from + (to - from) * share.min(1.0))
    }
}

/// The caller no longer wants the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped by the caller")]
pub struct Stopped;

/// Never stops.
pub fn never(_progress: f64) -> Result<(), Stopped> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_of_parts_is_progress_of_the_whole() {
        let reported = std::sync::Mutex::new(vec![]);
        let stop =
            |f: f64| -> Result<(), Stopped> { reported.lock().map(|mut t| t.push(f)).map_err(|_| Stopped) };
        let half = progress_within(&stop, [0.5, 1.0]);
        let pieces = progress_of_jobs(&half, [0.0, 0.5], 2);
        assert_eq!([half(0.5), pieces(0.9), pieces(1.0), pieces(1.0), pieces(1.0)], [Ok(()); 5]);
        assert_eq!(*reported.lock().expect("nobody panicked"), [0.75, 0.5, 0.625, 0.75, 0.75]);
    }
}
