//! Reads the lines before the header of a CSV file, which hold for all of its rows.

use super::{BALL, DISC, Kind, LARGEST, LENGTHS, PIXELS, Report, SHAPES, kind, misspelt, size_of};
use crate::scene::{DEFAULT_SIZE, Table, WorldKind};

/// Keys of the lines before the header.
const NOTES: [&str; 10] =
    ["fps", "scale", "size", "radius", "unit", "shape", "material", "setup", "world", "table"];

/// What the lines before the header tell.
pub(super) struct Notes {
    pub fps: Option<f64>,
    pub unit: Option<String>,
    pub scale: Option<f64>,
    pub size: f64,
    pub shape: Kind,
    pub material: String,
    pub world: WorldKind,
    pub setup: Option<String>,
    pub table: Option<Table>,
}

/// The key of a line whose form is a slip: `fps = 50`, or `size [mm]: 30`.
fn slip(line: &str) -> Option<&'static str> {
    let known = |key: &str| NOTES.into_iter().find(|note| key.trim().eq_ignore_ascii_case(note));
    let equated = line.split_once('=').and_then(|(key, _)| known(key));
    equated.or_else(|| line.split_once(':')?.0.split_once(['[', '(']).and_then(|(key, _)| known(key)))
}

impl Notes {
    pub fn read(text: &str, r: &mut Report) -> Notes {
        let mut size = None;
        let mut notes = Notes {
            fps: None,
            unit: None,
            scale: None,
            size: DEFAULT_SIZE,
            shape: DISC,
            material: String::new(),
            world: WorldKind::Table,
            setup: None,
            table: None,
        };
        let (mut shape, mut cushions) = (None, None);
        for (number, line) in text.lines().enumerate() {
            let Some(line) = line.trim().strip_prefix('#') else { continue };
            let at = || format!("line {}", number + 1);
            if let Some(key) = slip(line) {
                r.add(at(), format!("write \"# {key}: VALUE\", a unit behind the value"));
                continue;
            }
            let Some((key, value)) = line.split_once(':') else { continue };
            let (key, value) = (key.trim().to_ascii_lowercase(), value.trim());
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
                "size" | "radius" => {
                    let unit = value.split_whitespace().nth(1).map(str::to_ascii_lowercase);
                    size = positive().map(|size| (at(), size, unit));
                }
                "unit" => notes.unit = Some(value.to_ascii_lowercase()),
                "shape" => match kind(value) {
                    Some(kind) => shape = Some(kind),
                    None => r.add(at(), format!("shape is {value:?}; it must be {SHAPES}")),
                },
                "material" => notes.material = value.to_ascii_lowercase(),
                "table" => {
                    let numbers =
                        value.split([' ', ',', ';', '\t']).filter(|v| !v.is_empty()).map(str::parse);
                    match numbers.collect::<Result<Vec<f64>, _>>().as_deref() {
                        Ok(&[x0, x1, y0, y1]) => cushions = Some([x0, x1, y0, y1]),
                        _ => r.add(
                            at(),
                            format!("table is {value:?}; give its cushions as x low, x high, y low, y high"),
                        ),
                    }
                }
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
                "cushions" | "rails" => r.add(
                    at(),
                    format!("{key} is not known; write \"# table: x low, x high, y low, y high\""),
                ),
                // What people note for themselves is passed over; a slip of the pen is not.
                other => {
                    if let Some(near) = misspelt(other, NOTES.into_iter()) {
                        r.add(at(), format!("{other} is not known; did you mean {near}? rename it"));
                    }
                }
            }
        }
        let usual = if notes.world == WorldKind::Billiards { BALL } else { DISC };
        notes.shape = shape.unwrap_or(usual);
        // A unit that no length has is told with the columns.
        let metre = notes.unit.as_deref().and_then(|unit| notes.metres(unit)).unwrap_or(1.0);
        if let Some((at, size, unit)) = size {
            let own = unit.map_or(Some(metre), |unit| notes.metres(&unit));
            notes.size = size * own.unwrap_or(1.0);
            if own.is_none() {
                r.add(at, "size has an unknown unit; give m, cm or mm");
            } else if notes.size > LARGEST {
                let message =
                    format!("size is {} m; write \"# size: {size} mm\" if it is in millimetres", notes.size);
                r.add(at, message);
            }
        }
        notes.table = cushions.map(|all: [f64; 4]| {
            let [x0, x1, y0, y1] = all.map(|v| v * metre);
            Table { x: [x0, x1], y: [y0, y1] }
        });
        notes
    }

    /// A unit of length (m); none of one that is not known, nor of pixels without a scale.
    pub fn metres(&self, unit: &str) -> Option<f64> {
        if PIXELS.contains(&unit) { self.scale } else { size_of(&LENGTHS, unit) }
    }
}
