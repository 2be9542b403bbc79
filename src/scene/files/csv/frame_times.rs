//! When the frames of a table were taken: from its times, or from the numbers of its frames and a rate.

use crate::num::quantile;
use crate::scene::files::csv::notes::Notes;
use crate::scene::files::csv::rows::Row;
use crate::scene::limits::{DEFAULT_FPS, MAX_FRAMES};
use crate::scene::violations::{SceneError, readable};

/// Times closer than this share of the mean frame time are the same frame.
const SAME_TIME: f64 = 1e-3;
/// Largest share by which the rate of the times may differ from `fps`: a rate is written rounded, as 29.97 is 30.
const MAX_RATE_EXCESS: f64 = 0.01;
/// Later times (s) are no times of a video, which lasts hours at most, but of a calendar.
const LONGEST_VIDEO: f64 = 1e6;
/// Times of a calendar (s since 1970) with more than these digits are in finer units, by their sizes (s).
const FINE_UNITS: [(f64, f64, &str); 3] =
    [(1e17, 1e-9, "nanoseconds"), (1e14, 1e-6, "microseconds"), (1e11, 1e-3, "milliseconds")];
/// Times of a calendar have no more digits than this (s), as double precision holds them.
const CALENDAR_STEP: f64 = 1e-6;

/// Counts times and frames from the first one on where they cannot be meant as they are; says so.
pub(super) fn shift_to_start(timed: bool, rows: &mut [Row]) -> Option<String> {
    let first = rows.iter().map(|row| row.when).fold(f64::INFINITY, f64::min);
    let last = rows.iter().map(|row| row.when).fold(f64::NEG_INFINITY, f64::max);
    if !timed {
        let most = MAX_FRAMES as f64;
        let is_far = last >= most && last - first < most && last > first;
        if !(is_far || first < 0.0) || !first.is_finite() {
            return None;
        }
        rows.iter_mut().for_each(|row| row.when -= first);
        return Some(format!("frames counted from {} on, the first one", readable(first)));
    }
    if !first.is_finite() || (0.0..=LONGEST_VIDEO).contains(&first) {
        return None;
    }
    let fine = FINE_UNITS.iter().find(|(from, ..)| first > *from);
    let (unit, words) = fine.map_or((1.0, "s"), |(_, unit, words)| (*unit, words));
    let is_calendar = first > LONGEST_VIDEO;
    for row in rows.iter_mut() {
        let since = (row.when - first) * unit;
        row.when = if is_calendar { (since / CALENDAR_STEP).round() * CALENDAR_STEP } else { since };
    }
    Some(format!("times counted from the first one on, {first} {words}"))
}

/// Time of each frame (s) and the frame rate (1/s).
pub(super) fn frame_times(notes: &Notes, timed: bool, rows: &[Row]) -> Result<(Vec<f64>, f64), SceneError> {
    let mut whens: Vec<f64> = rows.iter().map(|row| row.when).collect();
    whens.sort_by(f64::total_cmp);
    if !timed {
        let fps = notes.fps.unwrap_or(DEFAULT_FPS);
        let last = whens.last().copied().unwrap_or(0.0);
        if last >= MAX_FRAMES as f64 {
            let message = format!(
                "{} is beyond the {MAX_FRAMES} frames that are allowed; split the video",
                readable(last)
            );
            return Err(SceneError::single("frame", message));
        }
        return Ok(((0..=last as usize).map(|f| f as f64 / fps).collect(), fps));
    }
    let span = whens.last().copied().unwrap_or(0.0) - whens.first().copied().unwrap_or(0.0);
    let distinct = |gap: f64| {
        let mut kept: Vec<f64> = whens.clone();
        kept.dedup_by(|b, a| *b - *a <= gap);
        kept
    };
    let rough = distinct(0.0);
    let times = distinct(SAME_TIME * span / rough.len().max(2) as f64);
    let rate = (times.len() as f64 - 1.0) / span;
    let rate = Some(rate).filter(|rate| rate.is_finite() && *rate > 0.0);
    // Some frames may be missing: most are not.
    let mut gaps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let usual = quantile(&mut gaps, 0.5).map(|gap| 1.0 / gap).filter(|rate| rate.is_finite() && *rate > 0.0);
    if let (Some(fps), Some(usual)) = (notes.fps, usual)
        && (fps / usual).max(usual / fps) > 1.0 + MAX_RATE_EXCESS
    {
        let (fps, usual) = (readable(fps), readable((10.0 * usual).round() / 10.0));
        let message = format!(
            "is {fps}, but the times in column t are those of {usual} frames a second; correct one of both, or leave out fps"
        );
        return Err(SceneError::single("fps", message));
    }
    Ok((times, notes.fps.or(rate).unwrap_or(DEFAULT_FPS)))
}
