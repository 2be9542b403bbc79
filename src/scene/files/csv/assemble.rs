//! Builds a scene from the rows of a CSV file.

use crate::num::{quantile, vec2};
use crate::scene::files::csv::notes::Notes;
use crate::scene::files::csv::rows::{CsvRows, Row};
use crate::scene::files::csv::vocabulary::ShapeKind;
use crate::scene::limits::{DEFAULT_FPS, MAX_FRAMES};
use crate::scene::object::{Object, Shape};
use crate::scene::observation::{Sample, Scene, Track};
use crate::scene::violations::{SceneError, SceneViolations, readable};
use std::collections::BTreeMap;

/// Times closer than this share of the mean frame time are the same frame.
const SAME_TIME: f64 = 1e-3;
/// Largest share by which the rate of the times may differ from `fps`.
const MAX_RATE_EXCESS: f64 = 0.05;
/// Largest median speed of an object (m/s), faster than sound. Larger ones come from a wrong unit.
const MAX_SPEED: f64 = 500.0;

/// The scene of a file.
pub(super) fn scene(name: &str, notes: &Notes, rows: CsvRows) -> Result<Scene, SceneError> {
    let CsvRows { timed, rows } = rows;
    let (times, fps) = frame_times(notes, timed, &rows)?;
    let mut r = SceneViolations::of_rows();
    let frame_of = |when: f64| match timed {
        true => times.partition_point(|t| *t <= when).saturating_sub(1),
        false => when as usize,
    };
    let (objects, tracks) = objects_and_tracks(notes, rows, frame_of, &mut r);
    for (object, track) in objects.iter().zip(&tracks) {
        if let Some((frame, yaw)) = track.yaw_in_degrees() {
            let message = format!(
                "is {}, which is not radians; name the column `yaw [deg]` if it holds degrees",
                readable(yaw)
            );
            r.add(format!("frame {frame}, object {}: yaw", object.id), message);
        }
        if let Some(speed) = median_speed(track, &times).filter(|speed| timed && *speed > MAX_SPEED) {
            let message = format!(
                "moves at {} m/s; at most {MAX_SPEED} m/s are allowed: check the units of t, x and y",
                readable(speed.round())
            );
            r.add(format!("object {}", object.id), message);
        }
    }
    r.finish()?;
    Ok(Scene {
        name: name.to_string(),
        setup: notes.setup.clone(),
        world: notes.world,
        fps,
        times,
        camera: None,
        table: notes.table,
        noise_sigma: None,
        objects,
        tracks,
        outliers: vec![],
        findings: vec![],
    })
}

/// Time of each frame (s) and the frame rate (1/s).
fn frame_times(notes: &Notes, timed: bool, rows: &[Row]) -> Result<(Vec<f64>, f64), SceneError> {
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

/// Objects in the order of their first rows, and their tracks.
fn objects_and_tracks(
    notes: &Notes,
    rows: Vec<Row>,
    frame_of: impl Fn(f64) -> usize,
    r: &mut SceneViolations,
) -> (Vec<Object>, Vec<Track>) {
    let (mut objects, mut tracks): (Vec<Object>, Vec<Track>) = (vec![], vec![]);
    // Shapes and sizes of the objects, and the line of each one's row in a frame.
    let (mut forms, mut lines): (Vec<(ShapeKind, f64)>, BTreeMap<_, u64>) = (vec![], BTreeMap::new());
    for row in rows {
        let at = objects.iter().position(|o| o.id == row.id).unwrap_or_else(|| {
            let (shape, material) = (Shape::Disc { radius: notes.size }, notes.material.clone());
            objects.push(Object { id: row.id, color: String::new(), material, shape, mass: None });
            tracks.push(Track::default());
            forms.push((notes.shape, notes.size));
            objects.len() - 1
        });
        let (Some(object), Some(track)) = (objects.get_mut(at), tracks.get_mut(at)) else { continue };
        if let Some((kind, size)) = forms.get_mut(at) {
            (*kind, *size) = (row.shape.unwrap_or(*kind), row.size.unwrap_or(*size));
            object.shape = kind.1(*size);
        }
        object.mass = row.mass.or(object.mass);
        object.material = row.material.unwrap_or(std::mem::take(&mut object.material));
        object.color = row.color.unwrap_or(std::mem::take(&mut object.color));
        let Some((x, y, yaw)) = row.seen else { continue };
        let frame = frame_of(row.when);
        let first = *lines.entry((at, frame)).or_insert(row.line);
        match track.samples.binary_search_by_key(&frame, |s| s.frame) {
            Ok(_) => r.add(
                format!("line {}", row.line),
                format!(
                    "is the second row of object {} at this time, after line {first}; keep one of them, or give the other \
                     object another id",
                    row.id
                ),
            ),
            Err(place) => {
                track.samples.insert(place, Sample { frame, position: vec2(x, y), yaw, covariance: None })
            }
        }
    }
    (objects, tracks)
}

/// Median speed (m/s) from each sample of a track to the next.
fn median_speed(track: &Track, times: &[f64]) -> Option<f64> {
    let at = |s: &Sample| Some((s.position, *times.get(s.frame)?));
    let mut speeds: Vec<f64> = track
        .samples
        .windows(2)
        .filter_map(|pair| {
            let ((x, t), (next, then)) = (at(pair.first()?)?, at(pair.last()?)?);
            Some((next - x).norm() / (then - t))
        })
        .collect();
    quantile(&mut speeds, 0.5)
}
