//! Reads tracks from CSV: one row an object and frame, columns by name.

mod notes;

use self::notes::Notes;
use super::validate::{Report, degrees};
use super::{MASS_RANGE, MAX_FRAMES, Object, SIZE_RANGE, Sample, Scene, SceneError, Shape, Track, Violation};
use crate::num::vec2;
use ::csv::{ReaderBuilder, StringRecord, Trim};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Frame rate where neither times nor a rate are given (1/s).
const FPS: f64 = 25.0;
/// Times closer than this share of a frame are one.
const SAME_TIME: f64 = 1e-3;
/// Farthest coordinate (m): longer than any pitch, rink or lane. Beyond it the numbers are no metres.
const FARTHEST: f64 = 200.0;
/// Largest radius or half side (m): more than a ship's breadth.
const LARGEST: f64 = 50.0;
/// Fastest motion on the average of an object (m/s): quicker than sound. Beyond it times are in another unit.
const FASTEST: f64 = 500.0;
/// What a file begins with.
const HEADER: &str = "id,t [s],x [mm],y [mm]";

/// What a column holds, and the names that it goes by.
const COLUMNS: [(Column, &[&str]); 12] = [
    (Column::Id, &["id", "object_id", "object", "track"]),
    (Column::Time, &["t", "time"]),
    (Column::Frame, &["frame"]),
    (Column::X, &["x"]),
    (Column::Y, &["y"]),
    (Column::Yaw, &["yaw", "theta", "angle"]),
    (Column::Visible, &["visible"]),
    (Column::Shape, &["shape"]),
    (Column::Size, &["size", "radius"]),
    (Column::Mass, &["mass"]),
    (Column::Material, &["material"]),
    (Column::Color, &["color", "colour"]),
];
/// Units by the size of what they measure in SI.
const LENGTHS: [(&str, f64); 3] = [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)];
const PIXELS: [&str; 3] = ["px", "pixel", "pixels"];
const TIMES: [(&str, f64); 2] = [("s", 1.0), ("ms", 1e-3)];
const ANGLES: [(&str, f64); 2] = [("rad", 1.0), ("deg", PI / 180.0)];
const MASSES: [(&str, f64); 2] = [("kg", 1.0), ("g", 1e-3)];

fn size_of(units: &[(&str, f64)], unit: &str) -> Option<f64> {
    units.iter().find(|(name, _)| *name == unit).map(|(_, size)| *size)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Column {
    Id,
    Time,
    Frame,
    X,
    Y,
    Yaw,
    Visible,
    Shape,
    Size,
    Mass,
    Material,
    Color,
}

/// Reads the text of a CSV file of tracks.
///
/// A header names the columns: `id`, `t` or `frame`, `x`, `y`, and where they are known `yaw`, `visible` (0 or 1),
/// `shape` (disc, ball, cube), `size` (radius or half side), `mass`, `material`, `color`. A unit stands behind a name, as in
/// `x [mm]` or `x_mm`: m, cm, mm, px; s, ms; rad, deg; kg, g. Lines `# key: value` before it tell what holds for all:
/// `fps`, `unit` (of lengths, `size` too), `scale` (m per pixel; without it pixels are refused), `size`, `shape`, `material`,
/// `world`, `setup`, `table` (its cushions: x low, x high, y low, y high). Columns part by commas, semicolons or tabs. Rows may come in any order, each object having one a time; what an
/// object has once, such as its mass, need stand in one of its rows only. Everything that is wrong is told at once, with
/// line and column.
pub fn parse_csv(name: &str, text: &str) -> Result<Scene, SceneError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut r = Report::of_rows();
    let notes = Notes::read(text, &mut r);
    let rows = rows(text, &notes, &mut r);
    r.finish()?;
    scene(name, &notes, rows?)?.validate()
}

/// A shape as it is called, and what a size (m) makes of it.
type Kind = (&'static str, fn(f64) -> Shape);

const DISC: Kind = ("disc", |radius| Shape::Disc { radius });
const BALL: Kind = ("ball", |radius| Shape::Ball { radius });
const SHAPES: &str = "disc, ball or cube";

fn kind(word: &str) -> Option<Kind> {
    match word.to_ascii_lowercase().as_str() {
        "disc" | "disk" | "puck" | "coin" | "cylinder" => Some(DISC),
        "ball" | "sphere" => Some(BALL),
        "cube" | "square" | "box" | "block" => Some(("cube", |half_side| Shape::Square { half_side })),
        _ => None,
    }
}

/// One row in SI units.
struct Row {
    line: u64,
    id: u32,
    /// s, or the number of the frame.
    when: f64,
    /// Where it was seen, and its yaw.
    seen: Option<(f64, f64, Option<f64>)>,
    shape: Option<Kind>,
    size: Option<f64>,
    mass: Option<f64>,
    material: Option<String>,
    color: Option<String>,
}

/// Share by which times may come quicker than `fps` says.
const OFF_CLOCK: f64 = 0.05;

/// Whether `when` counts seconds, and the rows.
type Rows = (bool, Vec<Row>);

/// A column of the file: where, and what a number in it is multiplied by.
type Place = (usize, f64);

fn rows(text: &str, notes: &Notes, r: &mut Report) -> Result<Rows, SceneError> {
    let header =
        text.lines().find(|l| !l.trim().is_empty() && !l.trim_start().starts_with('#')).unwrap_or_default();
    if header.is_empty() {
        r.add(
            "(file)",
            format!("has no rows; begin with a header such as `{HEADER}`, then one row an object and frame"),
        );
        return Ok((false, vec![]));
    }
    let delimiter = [b',', b';', b'\t'].into_iter().find(|d| header.as_bytes().contains(d)).unwrap_or(b',');
    let mut reader = ReaderBuilder::new()
        .delimiter(delimiter)
        .comment(Some(b'#'))
        .trim(Trim::All)
        .flexible(true)
        .from_reader(text.as_bytes());
    let names = reader.headers().map_err(|e| one("(file)", e.to_string()))?.clone();
    let places = places(&names, notes, r);
    let mut whole = true;
    for (column, wanted) in [(Column::Id, "id"), (Column::X, "x"), (Column::Y, "y")] {
        if !places.contains_key(&column) {
            whole = false;
            let found: Vec<&str> = names.iter().collect();
            let message =
                format!("has no column {wanted}; it has {}: rename the one that holds it", found.join(", "));
            r.add("header", message);
        }
    }
    let timed = places.contains_key(&Column::Time);
    if !timed && !places.contains_key(&Column::Frame) {
        whole = false;
        r.add("header", "has neither a column t nor a column frame; give one");
    }
    // Rows are not to blame for what the header lacks.
    if !whole {
        return Ok((timed, vec![]));
    }
    let (mut rows, mut kept) = (vec![], BTreeMap::new());
    for record in reader.records() {
        let record = match record {
            Ok(record) => record,
            Err(error) => {
                r.add("(file)", error.to_string());
                break;
            }
        };
        let line = record.position().map_or(0, |p| p.line());
        if record.len() != names.len() {
            r.add(
                format!("line {line}"),
                format!("has {} columns; the header has {}", record.len(), names.len()),
            );
            continue;
        }
        let mut cells = Cells { record: &record, names: &names, places: &places, line, kept: &mut kept, r };
        rows.extend(cells.row(timed));
    }
    if rows.is_empty() && r.is_empty() {
        r.add("(file)", "has a header only; give a row for each object and frame");
    }
    Ok((timed, rows))
}

fn one(path: impl Into<String>, message: impl Into<String>) -> SceneError {
    SceneError { violations: vec![Violation { path: path.into(), message: message.into() }] }
}

/// The known name that was meant, if this one differs from it by a slip or two.
fn misspelt<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let slips = |near: &str| match near.len() {
        // Of a short one only a letter too many: a row is no yaw.
        3 => usize::from(name.len() > 3),
        short @ ..6 => short / 4,
        _ => 2,
    };
    let off = |known: &&str| strsim::osa_distance(known, name);
    known.min_by_key(off).filter(|near| off(near) <= slips(near))
}

/// A name and the unit behind it: `x [mm]`, `x (mm)`, `x_mm`, `x/mm`.
fn parted(name: &str) -> (String, Option<String>) {
    let name = name.trim().to_ascii_lowercase();
    let known = |n: &str| COLUMNS.iter().any(|(_, names)| names.contains(&n));
    if known(&name) {
        return (name, None);
    }
    match name.rsplit_once(['[', '(', '_', '/', ' ']) {
        Some((stem, unit)) => {
            let unit = unit.trim_end_matches([']', ')']).trim().to_string();
            (stem.trim_end_matches(['[', '(', '_', '/', ' ']).to_string(), Some(unit))
        }
        None => (name, None),
    }
}

fn places(names: &StringRecord, notes: &Notes, r: &mut Report) -> BTreeMap<Column, Place> {
    let mut places = BTreeMap::new();
    for (index, whole) in names.iter().enumerate() {
        let (name, unit) = parted(whole);
        let at = format!("header, column {} ({whole})", index + 1);
        let Some((column, _)) = COLUMNS.iter().find(|(_, names)| names.contains(&name.as_str())) else {
            // Columns of no use here, such as a speed, are passed over; a slip of the pen is not.
            let known = COLUMNS.iter().flat_map(|(_, names)| names.iter().copied());
            if let Some(near) = misspelt(&name, known) {
                r.add(at, format!("is no known column; did you mean {near}? rename it"));
            }
            continue;
        };
        let units: &[(&str, f64)] = match column {
            Column::X | Column::Y | Column::Size => &LENGTHS,
            Column::Time => &TIMES,
            Column::Yaw => &ANGLES,
            Column::Mass => &MASSES,
            _ => &[],
        };
        let length = units == LENGTHS;
        let unit = unit.or_else(|| notes.unit.clone().filter(|_| length));
        let size = |unit: &str| if length { notes.metres(unit) } else { size_of(units, unit) };
        let factor = match unit.as_deref() {
            None => 1.0,
            Some(unit) => size(unit).unwrap_or_else(|| {
                let known = || units.iter().map(|u| u.0).collect::<Vec<_>>().join(", ");
                let message = match length && PIXELS.contains(&unit) {
                    true => {
                        "is in pixels; give the scale in a line `# scale: 0.002` (m per pixel)".to_string()
                    }
                    false => format!("has the unit {unit:?}; known: {}", known()),
                };
                r.add(at.clone(), message);
                1.0
            }),
        };
        if places.insert(*column, (index, factor)).is_some() {
            r.add(at, "is there twice");
        }
    }
    places
}

/// The cells of one row, by what they hold.
struct Cells<'a> {
    record: &'a StringRecord,
    names: &'a StringRecord,
    places: &'a BTreeMap<Column, Place>,
    line: u64,
    /// What objects have once: where it was told first, and how.
    kept: &'a mut BTreeMap<(u32, Column), (u64, String)>,
    r: &'a mut Report,
}

impl Cells<'_> {
    fn row(&mut self, timed: bool) -> Option<Row> {
        let id = self.whole(Column::Id);
        let when = if timed { self.number(Column::Time) } else { self.whole(Column::Frame).map(f64::from) };
        let clock = if timed { Column::Time } else { Column::Frame };
        if when.is_none() && self.lacks(clock) {
            self.wrong(clock, "is empty or NaN; say when it was");
        }
        let visible = match self.text(Column::Visible).map(str::to_ascii_lowercase).as_deref() {
            None | Some("1" | "true" | "yes") => true,
            Some("0" | "false" | "no") => false,
            Some(other) => {
                let message = format!("is {other:?}; it must be 0 or 1");
                self.wrong(Column::Visible, message);
                true
            }
        };
        let (x, y, yaw) = (self.number(Column::X), self.number(Column::Y), self.number(Column::Yaw));
        let seen = match (x, y) {
            (Some(x), Some(y)) if visible => Some((x, y, yaw)),
            (None, Some(_)) if visible && self.lacks(Column::X) => {
                self.wrong(
                    Column::X,
                    "is empty or NaN, but y is not; leave both empty where it was not seen",
                );
                None
            }
            (Some(_), None) if visible && self.lacks(Column::Y) => {
                self.wrong(
                    Column::Y,
                    "is empty or NaN, but x is not; leave both empty where it was not seen",
                );
                None
            }
            _ => None,
        };
        if let Some((x, y, _)) = seen {
            self.near(Column::X, x);
            self.near(Column::Y, y);
        }
        let word = self.text(Column::Shape).map(str::to_string);
        let shape = word.as_deref().and_then(kind);
        if let (Some(word), None) = (word, shape) {
            self.wrong(Column::Shape, format!("is {word:?}; it must be {SHAPES}"));
        }
        let (size, mass) = (
            self.within(Column::Size, [SIZE_RANGE[0], LARGEST], "m"),
            self.within(Column::Mass, MASS_RANGE, "kg"),
        );
        let [material, color] =
            [Column::Material, Column::Color].map(|c| self.text(c).map(str::to_ascii_lowercase));
        let id = id?;
        self.keeps(id, Column::Shape, shape.map(|kind| kind.0.to_string()));
        self.keeps(id, Column::Size, size.map(|v| format!("{v} m")));
        self.keeps(id, Column::Mass, mass.map(|v| format!("{v} kg")));
        self.keeps(id, Column::Material, material.clone());
        self.keeps(id, Column::Color, color.clone());
        Some(Row { line: self.line, id, when: when?, seen, shape, size, mass, material, color })
    }

    /// An object has one of it: the first row that tells it holds.
    fn keeps(&mut self, id: u32, column: Column, value: Option<String>) {
        let Some(value) = value else { return };
        let (line, told) = self.kept.entry((id, column)).or_insert_with(|| (self.line, value.clone()));
        if *told != value {
            let message = format!(
                "is {value:?} where object {id} has {told:?} in line {line}; give all its rows the same, or what \
                 is another object another id"
            );
            self.wrong(column, message);
        }
    }

    fn near(&mut self, column: Column, value: f64) {
        if value.abs() > FARTHEST {
            let name = if column == Column::X { "x" } else { "y" };
            let message = format!(
                "is {value} m, and nothing that is filmed is beyond {FARTHEST} m; if it is in millimetres, name the \
                 column `{name} [mm]`, and `{name} [px]` if in pixels"
            );
            self.wrong(column, message);
        }
    }

    /// A number in SI units that a scene may have.
    fn within(&mut self, column: Column, [low, high]: [f64; 2], unit: &str) -> Option<f64> {
        let value = self.number(column)?;
        let fits = (low..=high).contains(&value);
        if !fits {
            self.wrong(column, format!("is {value} {unit}; it must be from {low:e} to {high:e} {unit}"));
        }
        fits.then_some(value)
    }

    fn text(&self, column: Column) -> Option<&str> {
        let (index, _) = self.places.get(&column)?;
        self.record.get(*index).filter(|cell| !cell.is_empty())
    }

    /// Whether the cell is empty or NaN.
    fn lacks(&self, column: Column) -> bool {
        self.text(column).is_none_or(|text| text.eq_ignore_ascii_case("nan"))
    }

    /// A number in SI units; `None` where the cell is empty, NaN or wrong.
    fn number(&mut self, column: Column) -> Option<f64> {
        let factor = self.places.get(&column)?.1;
        let text = self.text(column)?.to_string();
        match text.parse::<f64>() {
            Ok(v) if v.is_finite() => Some(v * factor),
            _ if text.eq_ignore_ascii_case("nan") => None,
            _ => {
                let wanted = match column {
                    Column::Id => "objects have numbers for names: give a whole number from 0 on",
                    _ if text.replace(',', ".").parse::<f64>().is_ok() => {
                        "write a point before decimals: 1.5, not 1,5"
                    }
                    _ => "give a number such as 1.5",
                };
                self.wrong(column, format!("is {text:?}; {wanted}"));
                None
            }
        }
    }

    fn whole(&mut self, column: Column) -> Option<u32> {
        let value = self.number(column)?;
        let whole = value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0;
        if !whole {
            self.wrong(column, format!("is {value}; give a whole number from 0 on"));
        }
        whole.then_some(value as u32)
    }

    fn wrong(&mut self, column: Column, message: impl Into<String>) {
        let at = match self.places.get(&column) {
            Some((index, _)) => {
                let name = self.names.get(*index).unwrap_or_default();
                format!("line {}, column {} ({name})", self.line, index + 1)
            }
            None => format!("line {}", self.line),
        };
        self.r.add(at, message);
    }
}

fn scene(name: &str, notes: &Notes, (timed, rows): Rows) -> Result<Scene, SceneError> {
    let mut whens: Vec<f64> = rows.iter().map(|row| row.when).collect();
    whens.sort_by(f64::total_cmp);
    let (times, fps) = if timed {
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
        // Frames may be left out, but there are none between two.
        if let (Some(fps), Some(rate)) = (notes.fps, rate)
            && fps * (1.0 + OFF_CLOCK) < rate
        {
            let message = format!(
                "is {fps}, but there are {rate:.1} times a second; correct one of both, or leave it out"
            );
            return Err(one("fps", message));
        }
        (times, notes.fps.or(rate).unwrap_or(FPS))
    } else {
        let fps = notes.fps.unwrap_or(FPS);
        let last = whens.last().copied().unwrap_or(0.0);
        if last >= MAX_FRAMES as f64 {
            return Err(one("frame", format!("{last} is beyond the {MAX_FRAMES} frames that are allowed")));
        }
        ((0..=last as usize).map(|f| f as f64 / fps).collect(), fps)
    };
    let mut r = Report::of_rows();
    let (mut objects, mut tracks): (Vec<Object>, Vec<Track>) = (vec![], vec![]);
    // Kinds and sizes of the objects, and the line of each one's row in a frame.
    let (mut forms, mut lines): (Vec<(Kind, f64)>, BTreeMap<_, u64>) = (vec![], BTreeMap::new());
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
        let frame = match timed {
            true => times.partition_point(|t| *t <= row.when).saturating_sub(1),
            false => row.when as usize,
        };
        let first = *lines.entry((at, frame)).or_insert(row.line);
        match track.samples.binary_search_by_key(&frame, |s| s.frame) {
            Ok(_) => r.add(
                format!("line {}", row.line),
                format!(
                    "is the second row of object {} at this time, after line {first}; rows may come in any order, \
                     but keep one of these, or give another object another id",
                    row.id
                ),
            ),
            Err(place) => {
                track.samples.insert(place, Sample { frame, position: vec2(x, y), yaw, covariance: None })
            }
        }
    }
    for (object, track) in objects.iter().zip(&tracks) {
        if let Some((frame, yaw)) = degrees(track) {
            let message = format!(
                "is {yaw}, which is no yaw in radians; name the column `yaw [deg]` if it holds degrees"
            );
            r.add(format!("frame {frame}, object {}: yaw", object.id), message);
        }
        if let Some(speed) = speed(track, &times).filter(|speed| timed && *speed > FASTEST) {
            let message = format!(
                "moves at {speed:.0} m/s, and nothing that is filmed does; check the units of t, x and y"
            );
            r.add(format!("object {}", object.id), message);
        }
    }
    r.finish()?;
    let (world, setup) = (notes.world, notes.setup.clone());
    let name = name.to_string();
    Ok(Scene {
        name,
        setup,
        world,
        fps,
        times,
        camera: None,
        table: notes.table,
        noise_sigma: None,
        objects,
        tracks,
        outliers: vec![],
    })
}

/// The median speed (m/s) from each row of an object to the next.
fn speed(track: &Track, times: &[f64]) -> Option<f64> {
    let at = |s: &Sample| Some((s.position, *times.get(s.frame)?));
    let mut speeds: Vec<f64> = track
        .samples
        .windows(2)
        .filter_map(|pair| {
            let ((x, t), (next, then)) = (at(pair.first()?)?, at(pair.last()?)?);
            Some((next - x).norm() / (then - t))
        })
        .collect();
    speeds.sort_by(f64::total_cmp);
    speeds.get(speeds.len() / 2).copied()
}

#[cfg(test)]
mod tests;
