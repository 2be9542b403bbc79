//! The lines `# key: value` before the header of a CSV file, which hold for all of its rows.

use crate::scene::files::csv::vocabulary::{
    BALL, DISC, LENGTHS, MAX_SIZE, PIXELS, SHAPES, ShapeKind, shape_kind, size_of,
};
use crate::scene::limits::DEFAULT_SIZE;
use crate::scene::observation::{Table, WorldKind};
use crate::scene::spelling::misspelt;
use crate::scene::violations::{SceneViolations, readable};

/// Keys of the lines before the header.
const KEYS: [&str; 10] =
    ["fps", "scale", "size", "radius", "unit", "shape", "material", "setup", "world", "table"];

/// Values that hold where a table does not state them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TableDefaults {
    /// Frame rate (1/s).
    pub fps: Option<f64>,
    /// Unit of lengths.
    pub unit: Option<String>,
    /// Size of a pixel (m).
    pub scale: Option<f64>,
    /// Radius or half side of an object (m).
    pub size: Option<f64>,
}

/// What the lines before the header state.
#[derive(Clone)]
pub(super) struct Notes {
    /// Frame rate (1/s).
    pub fps: Option<f64>,
    /// Unit of lengths.
    pub unit: Option<String>,
    /// Size of a pixel (m).
    pub scale: Option<f64>,
    /// Radius or half side of an object (m).
    pub size: f64,
    /// Whether a line gives the size.
    pub has_size: bool,
    /// Whether a line gives the world.
    pub has_world: bool,
    pub shape: ShapeKind,
    pub material: String,
    pub world: WorldKind,
    pub setup: Option<String>,
    pub table: Option<Table>,
}

/// Values that are interpreted once all lines are read.
#[derive(Default)]
struct Pending {
    shape: Option<ShapeKind>,
    /// Where it stands, the number, and its own unit.
    size: Option<(String, f64, Option<String>)>,
    /// x low, x high, y low, y high, in the file's unit.
    cushions: Option<[f64; 4]>,
}

/// The key of a line in a wrong form: `fps = 50`, or `size [mm]: 30`.
fn key_in_wrong_form(line: &str) -> Option<&'static str> {
    let known = |key: &str| KEYS.into_iter().find(|note| key.trim().eq_ignore_ascii_case(note));
    let equated = line.split_once('=').and_then(|(key, _)| known(key));
    equated.or_else(|| line.split_once(':')?.0.split_once(['[', '(']).and_then(|(key, _)| known(key)))
}

/// The number above 0 at the start of a value: "0.002 m/px" is 0.002.
fn positive(value: &str) -> Option<f64> {
    let number = value.split_whitespace().next().and_then(|v| v.parse::<f64>().ok());
    number.filter(|v| v.is_finite() && *v > 0.0)
}

impl Notes {
    pub fn read(text: &str, defaults: &TableDefaults, r: &mut SceneViolations) -> Notes {
        let mut notes = Notes {
            fps: None,
            unit: None,
            scale: None,
            size: DEFAULT_SIZE,
            has_size: false,
            has_world: false,
            shape: DISC,
            material: String::new(),
            world: WorldKind::Table,
            setup: None,
            table: None,
        };
        let mut pending = Pending::default();
        for (number, line) in text.lines().enumerate() {
            let Some(line) = line.trim().strip_prefix('#') else { continue };
            let at = format!("line {}", number + 1);
            if let Some(key) = key_in_wrong_form(line) {
                r.add(at, format!("write \"# {key}: VALUE\", a unit behind the value"));
                continue;
            }
            let Some((key, value)) = line.split_once(':') else { continue };
            let key = key.trim().to_ascii_lowercase();
            if let Err(message) = notes.set(&key, value.trim(), &at, &mut pending) {
                r.add(at, message);
            }
        }
        notes.fps = notes.fps.or(defaults.fps);
        notes.scale = notes.scale.or(defaults.scale);
        notes.unit = notes.unit.take().or_else(|| defaults.unit.clone());
        notes.finish(pending, r);
        if let Some(size) = defaults.size.filter(|_| !notes.has_size) {
            (notes.size, notes.has_size) = (size, true);
        }
        notes
    }

    /// Takes the value of a key, or says what is wrong with it. Unknown keys are ignored; misspelt ones are wrong.
    fn set(&mut self, key: &str, value: &str, at: &str, pending: &mut Pending) -> Result<(), String> {
        let number = || positive(value).ok_or_else(|| format!("{key} is {value:?}; give a number above 0"));
        match key {
            "fps" => self.fps = positive(value),
            "scale" => self.scale = positive(value),
            "size" | "radius" => {
                let unit = value.split_whitespace().nth(1).map(str::to_ascii_lowercase);
                self.has_size = true;
                pending.size = positive(value).map(|size| (at.to_string(), size, unit));
            }
            "unit" => self.unit = Some(value.to_ascii_lowercase()),
            "shape" => {
                let kind = shape_kind(value);
                let wrong = || format!("shape is {value:?}; it must be {SHAPES}");
                pending.shape = Some(kind.ok_or_else(wrong)?);
            }
            "material" => self.material = value.to_ascii_lowercase(),
            "table" => {
                let numbers = value.split([' ', ',', ';', '\t']).filter(|v| !v.is_empty()).map(str::parse);
                match numbers.collect::<Result<Vec<f64>, _>>().as_deref() {
                    Ok(&[x0, x1, y0, y1]) => pending.cushions = Some([x0, x1, y0, y1]),
                    _ => {
                        let wanted = "give its cushions as x low, x high, y low, y high";
                        return Err(format!("table is {value:?}; {wanted}"));
                    }
                }
            }
            "setup" => self.setup = Some(value.to_string()),
            "world" => {
                let wrong =
                    || format!("world is {value:?}; it must be clevrer, table, air_table or billiards");
                self.has_world = true;
                self.world = WorldKind::named(&value.to_ascii_lowercase()).ok_or_else(wrong)?;
            }
            "cushions" | "rails" => {
                return Err(format!("{key} is not known; write \"# table: x low, x high, y low, y high\""));
            }
            other => {
                if let Some(near) = misspelt(other, KEYS.into_iter()) {
                    return Err(format!("{other} is not known; did you mean {near}? rename it"));
                }
            }
        }
        match key {
            "fps" | "scale" | "size" | "radius" => number().map(drop),
            _ => Ok(()),
        }
    }

    /// Interprets shape, size and cushions, which depend on other lines.
    fn finish(&mut self, pending: Pending, r: &mut SceneViolations) {
        let usual = if self.world == WorldKind::Billiards { BALL } else { DISC };
        self.shape = pending.shape.unwrap_or(usual);
        // An unknown unit is reported with the columns.
        let metre = self.unit.as_deref().and_then(|unit| self.metres(unit)).unwrap_or(1.0);
        if let Some((at, size, unit)) = pending.size {
            let own = unit.map_or(Some(metre), |unit| self.metres(&unit));
            self.size = size * own.unwrap_or(1.0);
            if own.is_none() {
                r.add(at, "size has an unknown unit; give m, cm or mm");
            } else if self.size > MAX_SIZE {
                let message = format!(
                    "size is {} m; write \"# size: {} mm\" if it is in millimetres",
                    readable(self.size),
                    readable(size)
                );
                r.add(at, message);
            }
        }
        self.table = pending.cushions.map(|all: [f64; 4]| {
            let [x0, x1, y0, y1] = all.map(|v| v * metre);
            Table { x: [x0, x1], y: [y0, y1] }
        });
    }

    /// Size of a unit of length (m); `None` for an unknown unit, or pixels without a scale.
    pub fn metres(&self, unit: &str) -> Option<f64> {
        if PIXELS.contains(&unit) { self.scale } else { size_of(&LENGTHS, unit) }
    }
}
