//! Builds a scene from the rows of a table.

use crate::num::{quantile, vec2};
use crate::scene::files::csv::frame_times::{frame_times, shift_to_start};
use crate::scene::files::csv::ids::ObjectNames;
use crate::scene::files::csv::notes::Notes;
use crate::scene::files::csv::rows::{CsvRows, Row};
use crate::scene::files::csv::vocabulary::ShapeKind;
use crate::scene::object::{Object, Shape};
use crate::scene::observation::{Sample, Scene, Track};
use crate::scene::violations::{SceneError, SceneViolations, readable};
use std::collections::BTreeMap;

/// Largest median speed of an object (m/s), faster than sound. Larger ones come from a wrong unit.
const MAX_SPEED: f64 = 500.0;

/// The scene of a file, and what was assumed of its rows, a line each.
pub(super) fn scene(name: &str, notes: &Notes, rows: CsvRows) -> Result<(Scene, Vec<String>), SceneError> {
    let CsvRows { timed, mut rows, names, has_ids, mut assumed, .. } = rows;
    assumed.extend(shift_to_start(timed, &mut rows));
    let (times, fps) = frame_times(notes, timed, &rows)?;
    let mut r = SceneViolations::of_rows();
    let frame_of = |when: f64| match timed {
        true => times.partition_point(|t| *t <= when).saturating_sub(1),
        false => when as usize,
    };
    let (objects, tracks, repeats) = objects_and_tracks(notes, (rows, &names, has_ids), frame_of, &mut r);
    if repeats > 0 {
        assumed.push(format!("one row in place of several equal ones ({repeats} rows are ignored)"));
    }
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
    let scene = Scene {
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
        feature_layout: None,
        absent: vec![],
    };
    Ok((scene, assumed))
}

/// Objects by id and their tracks, and the number of rows that are as another one.
fn objects_and_tracks(
    notes: &Notes,
    (rows, names, has_ids): (Vec<Row>, &ObjectNames, bool),
    frame_of: impl Fn(f64) -> usize,
    r: &mut SceneViolations,
) -> (Vec<Object>, Vec<Track>, usize) {
    let numbers = names.numbers();
    let (mut found, mut repeats): (BTreeMap<u32, ObjectRows>, usize) = (BTreeMap::new(), 0);
    for row in rows {
        let id = numbers.get(row.object).copied().unwrap_or(0);
        let object = found.entry(id).or_insert_with(|| ObjectRows::new(id, notes));
        let properties = &mut object.object;
        object.form = (row.shape.unwrap_or(object.form.0), row.size.unwrap_or(object.form.1));
        properties.shape = object.form.0.1(object.form.1);
        properties.mass = row.mass.or(properties.mass);
        properties.material = row.material.unwrap_or(std::mem::take(&mut properties.material));
        properties.color = row.color.unwrap_or(std::mem::take(&mut properties.color));
        let Some((x, y, yaw)) = row.seen else { continue };
        let frame = frame_of(row.when);
        let first = *object.lines.entry(frame).or_insert(row.line);
        let sample = Sample { frame, position: vec2(x, y), yaw, covariance: None };
        let samples = &mut object.track.samples;
        match samples.binary_search_by_key(&frame, |s| s.frame) {
            Ok(known) if samples.get(known) == Some(&sample) => repeats += 1,
            Ok(_) if !has_ids => r.add(
                format!("line {}", row.line),
                format!(
                    "is the second position at this time, after line {first}, and no column tells objects apart; add a column \
                     `id`, or link the detections into tracks first"
                ),
            ),
            Ok(_) => r.add(
                format!("line {}", row.line),
                format!(
                    "is the second row of object {} at this time, after line {first}; keep one of them, or give the other \
                     object another id",
                    names.name(row.object)
                ),
            ),
            Err(place) => samples.insert(place, sample),
        }
    }
    let (objects, tracks) = found.into_values().map(|o| (o.object, o.track)).unzip();
    (objects, tracks, repeats)
}

/// One object, as far as its rows are read.
struct ObjectRows {
    object: Object,
    track: Track,
    form: (ShapeKind, f64),
    /// The line of its row in each frame.
    lines: BTreeMap<usize, u64>,
}

impl ObjectRows {
    fn new(id: u32, notes: &Notes) -> Self {
        let (shape, material) = (Shape::Disc { radius: notes.size }, notes.material.clone());
        let object = Object { id, color: String::new(), material, shape, mass: None, features: vec![] };
        ObjectRows {
            object,
            track: Track::default(),
            form: (notes.shape, notes.size),
            lines: BTreeMap::new(),
        }
    }
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
