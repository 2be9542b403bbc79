//! Reads tracks from CSV: one row an object and frame, columns by name.

use super::validate::{Report, degrees};
use super::{
    DEFAULT_SIZE, MAX_FRAMES, Object, Sample, Scene, SceneError, Shape, Track, Violation, WorldKind,
};
use crate::num::vec2;
use ::csv::{ReaderBuilder, StringRecord, Trim};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Frame rate where neither times nor a rate are given (1/s).
const FPS: f64 = 25.0;
/// Times closer than this share of a frame are one.
const SAME_TIME: f64 = 1e-3;

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
/// Keys of the lines before the header.
const NOTES: [&str; 9] = ["fps", "scale", "size", "radius", "unit", "shape", "material", "setup", "world"];
/// Units by the size of what they measure in SI.
const LENGTHS: [(&str, f64); 3] = [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)];
const TIMES: [(&str, f64); 2] = [("s", 1.0), ("ms", 1e-3)];
const ANGLES: [(&str, f64); 2] = [("rad", 1.0), ("deg", PI / 180.0)];
const MASSES: [(&str, f64); 2] = [("kg", 1.0), ("g", 1e-3)];

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
/// `fps`, `unit` (of lengths), `scale` (m per pixel; without it pixels are refused), `size`, `shape`, `material`, `world`,
/// `setup`. Columns part by commas, semicolons or tabs. Everything that is wrong is told at once, with line and column.
pub fn parse_csv(name: &str, text: &str) -> Result<Scene, SceneError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut r = Report::default();
    let notes = Notes::read(text, &mut r);
    let rows = rows(text, &notes, &mut r);
    r.finish()?;
    let scene = scene(name, &notes, rows?)?;
    scene.validate()?;
    Ok(scene)
}

/// What the lines before the header tell.
struct Notes {
    fps: Option<f64>,
    unit: Option<String>,
    scale: Option<f64>,
    size: f64,
    shape: String,
    material: String,
    world: WorldKind,
    setup: Option<String>,
}

impl Notes {
    fn read(text: &str, r: &mut Report) -> Notes {
        let mut notes = Notes {
            fps: None,
            unit: None,
            scale: None,
            size: DEFAULT_SIZE,
            shape: "disc".into(),
            material: String::new(),
            world: WorldKind::Table,
            setup: None,
        };
        for (number, line) in text.lines().enumerate() {
            let Some((key, value)) = line.trim().strip_prefix('#').and_then(|l| l.split_once(':')) else {
                continue;
            };
            let (key, value) = (key.trim().to_ascii_lowercase(), value.trim());
            let at = || format!("line {}", number + 1);
            let mut positive = || {
                // "0.002 m/px" is 0.002.
                let number = value.split_whitespace().next().and_then(|v| v.parse::<f64>().ok());
                let number = number.filter(|v| v.is_finite() && *v > 0.0);
                if number.is_none() {
                    r.add(at(), format!("{key} is {value:?}; give a number above 0"));
                }
                number
            };
            match key.as_str() {
                "fps" => notes.fps = positive(),
                "scale" => notes.scale = positive(),
                "size" | "radius" => notes.size = positive().unwrap_or(DEFAULT_SIZE),
                "unit" => notes.unit = Some(value.to_ascii_lowercase()),
                "shape" => notes.shape = value.to_string(),
                "material" => notes.material = value.to_ascii_lowercase(),
                "setup" => notes.setup = Some(value.to_string()),
                "world" => match value.to_ascii_lowercase().as_str() {
                    "clevrer" => notes.world = WorldKind::Clevrer,
                    "table" => notes.world = WorldKind::Table,
                    "air_table" => notes.world = WorldKind::AirTable,
                    "billiards" => notes.world = WorldKind::Billiards,
                    _ => r.add(
                        at(),
                        format!("world is {value:?}; it must be clevrer, table, air_table or billiards"),
                    ),
                },
                // What people note for themselves is passed over; a slip of the pen is not.
                other => {
                    if let Some(near) = misspelt(other, NOTES.into_iter()) {
                        r.add(at(), format!("{other} is not known; did you mean {near}? rename it"));
                    }
                }
            }
        }
        notes
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
    shape: Option<Shape>,
    mass: Option<f64>,
    material: Option<String>,
    color: Option<String>,
}

/// Whether `when` counts seconds, and the rows.
type Rows = (bool, Vec<Row>);

/// A column of the file: where, and what a number in it is multiplied by.
type Place = (usize, f64);

fn rows(text: &str, notes: &Notes, r: &mut Report) -> Result<Rows, SceneError> {
    let header =
        text.lines().find(|l| !l.trim().is_empty() && !l.trim_start().starts_with('#')).unwrap_or_default();
    let delimiter = [b',', b';', b'\t'].into_iter().find(|d| header.as_bytes().contains(d)).unwrap_or(b',');
    let mut reader = ReaderBuilder::new()
        .delimiter(delimiter)
        .comment(Some(b'#'))
        .trim(Trim::All)
        .flexible(true)
        .from_reader(text.as_bytes());
    let names = reader.headers().map_err(|e| one("(file)", e.to_string()))?.clone();
    let places = places(&names, notes, r);
    for (column, wanted) in [(Column::Id, "id"), (Column::X, "x"), (Column::Y, "y")] {
        if !places.contains_key(&column) {
            let found: Vec<&str> = names.iter().collect();
            r.add("header", format!("has no column {wanted}; it has {}", found.join(", ")));
        }
    }
    let timed = places.contains_key(&Column::Time);
    if !timed && !places.contains_key(&Column::Frame) {
        r.add("header", "has neither a column t nor a column frame");
    }
    let mut rows = vec![];
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
        let mut cells = Cells { record: &record, names: &names, places: &places, line, r };
        rows.extend(cells.row(timed, notes));
    }
    if rows.is_empty() {
        r.add("(file)", "has no row that can be read; give one for each object and frame");
    }
    Ok((timed, rows))
}

fn one(path: impl Into<String>, message: impl Into<String>) -> SceneError {
    SceneError { violations: vec![Violation { path: path.into(), message: message.into() }] }
}

/// The known name that was meant, if this one differs from it by a slip or two.
fn misspelt<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let slips = |near: &str| if near.len() < 6 { near.len() / 4 } else { 2 };
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
        let factor = match (unit.as_deref(), notes.scale) {
            (None, _) => 1.0,
            (Some("px" | "pixel" | "pixels"), Some(scale)) if length => scale,
            (Some("px" | "pixel" | "pixels"), None) if length => {
                r.add(at.clone(), "is in pixels; give the scale in a line `# scale: 0.002` (m per pixel)");
                1.0
            }
            (Some(unit), _) => match units.iter().find(|(name, _)| *name == unit) {
                Some((_, factor)) => *factor,
                None => {
                    let known: Vec<&str> = units.iter().map(|u| u.0).collect();
                    r.add(at.clone(), format!("has the unit {unit:?}; known: {}", known.join(", ")));
                    1.0
                }
            },
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
    r: &'a mut Report,
}

impl Cells<'_> {
    fn row(&mut self, timed: bool, notes: &Notes) -> Option<Row> {
        let id = self.whole(Column::Id);
        let when = if timed { self.number(Column::Time) } else { self.whole(Column::Frame).map(f64::from) };
        if when.is_none() {
            self.wrong(if timed { Column::Time } else { Column::Frame }, "is empty or NaN; say when it was");
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
            (None, Some(_)) if visible => {
                self.wrong(Column::X, "is empty or NaN, but y is not");
                None
            }
            (Some(_), None) if visible => {
                self.wrong(Column::Y, "is empty or NaN, but x is not");
                None
            }
            _ => None,
        };
        let size = self.number(Column::Size).unwrap_or(notes.size);
        let word = self.text(Column::Shape).unwrap_or(&notes.shape).to_ascii_lowercase();
        let shape = match word.as_str() {
            "disc" | "disk" | "puck" | "coin" | "cylinder" => Some(Shape::Disc { radius: size }),
            "ball" | "sphere" => Some(Shape::Ball { radius: size }),
            "cube" | "square" | "box" | "block" => Some(Shape::Square { half_side: size }),
            _ => {
                self.wrong(Column::Shape, format!("is {word:?}; it must be disc, ball or cube"));
                None
            }
        };
        let mass = self.number(Column::Mass);
        let [material, color] =
            [Column::Material, Column::Color].map(|c| self.text(c).map(str::to_ascii_lowercase));
        Some(Row { line: self.line, id: id?, when: when?, seen, shape, mass, material, color })
    }

    fn text(&self, column: Column) -> Option<&str> {
        let (index, _) = self.places.get(&column)?;
        self.record.get(*index).filter(|cell| !cell.is_empty())
    }

    /// A number in SI units; `None` where the cell is empty, NaN or wrong.
    fn number(&mut self, column: Column) -> Option<f64> {
        let factor = self.places.get(&column)?.1;
        let text = self.text(column)?.to_string();
        match text.parse::<f64>() {
            Ok(v) if v.is_finite() => Some(v * factor),
            _ if text.eq_ignore_ascii_case("nan") => None,
            _ => {
                self.wrong(column, format!("is {text:?}; give a number"));
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
        (times, notes.fps.unwrap_or(if rate.is_finite() && rate > 0.0 { rate } else { FPS }))
    } else {
        let fps = notes.fps.unwrap_or(FPS);
        let last = whens.last().copied().unwrap_or(0.0);
        if last >= MAX_FRAMES as f64 {
            return Err(one("frame", format!("{last} is beyond the {MAX_FRAMES} frames that are allowed")));
        }
        ((0..=last as usize).map(|f| f as f64 / fps).collect(), fps)
    };
    let mut r = Report::default();
    let (mut objects, mut tracks): (Vec<Object>, Vec<Track>) = (vec![], vec![]);
    for row in rows {
        let at = objects.iter().position(|o| o.id == row.id).unwrap_or_else(|| {
            let (shape, material) = (Shape::Disc { radius: notes.size }, notes.material.clone());
            objects.push(Object { id: row.id, color: String::new(), material, shape, mass: None });
            tracks.push(Track::default());
            objects.len() - 1
        });
        let (Some(object), Some(track)) = (objects.get_mut(at), tracks.get_mut(at)) else { continue };
        object.shape = row.shape.unwrap_or(object.shape);
        object.mass = row.mass.or(object.mass);
        object.material = row.material.unwrap_or(std::mem::take(&mut object.material));
        object.color = row.color.unwrap_or(std::mem::take(&mut object.color));
        let Some((x, y, yaw)) = row.seen else { continue };
        let frame = match timed {
            true => times.partition_point(|t| *t <= row.when).saturating_sub(1),
            false => row.when as usize,
        };
        match track.samples.binary_search_by_key(&frame, |s| s.frame) {
            Ok(_) => r.add(
                format!("line {}", row.line),
                format!("is the second row of object {} at this time", row.id),
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
        table: None,
        noise_sigma: None,
        objects,
        tracks,
    })
}

#[cfg(test)]
mod tests;
