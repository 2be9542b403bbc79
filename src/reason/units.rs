//! Usual units as data: questions and answers may use any of them; programs compute in SI units.

/// Decimals of a number that counts as short.
const DECIMALS: f64 = 1e4;

/// A unit: its token in programs, the SI unit of the same kind, and its size in that unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasureUnit {
    pub name: &'static str,
    pub base: &'static str,
    pub size: f64,
}

const fn unit(name: &'static str, base: &'static str, size: f64) -> MeasureUnit {
    MeasureUnit { name, base, size }
}

/// All units. The words for them are lines of `reader/words.txt`.
pub static UNITS: &[MeasureUnit] = &[
    unit("m", "m", 1.0),
    unit("cm", "m", 0.01),
    unit("mm", "m", 0.001),
    unit("km", "m", 1000.0),
    unit("inch", "m", 0.0254),
    unit("foot", "m", 0.3048),
    unit("s", "s", 1.0),
    unit("ms", "s", 0.001),
    unit("min", "s", 60.0),
    unit("m/s", "m/s", 1.0),
    unit("cm/s", "m/s", 0.01),
    unit("mm/s", "m/s", 0.001),
    unit("km/h", "m/s", 1.0 / 3.6),
    unit("mph", "m/s", 0.44704),
    unit("ft/s", "m/s", 0.3048),
    unit("m/s^2", "m/s^2", 1.0),
    unit("rad/s", "rad/s", 1.0),
    unit("deg/s", "rad/s", std::f64::consts::PI / 180.0),
    unit("rpm", "rad/s", std::f64::consts::PI / 30.0),
    unit("kg", "kg", 1.0),
    unit("g", "kg", 0.001),
    unit("J", "J", 1.0),
    unit("mJ", "J", 0.001),
];

/// The unit of a token.
pub fn named(name: &str) -> Option<&'static MeasureUnit> {
    UNITS.iter().find(|u| u.name == name)
}

impl MeasureUnit {
    /// So many of this unit in the SI unit. A decimal stays one: 25 cm are 0.25 m.
    pub fn in_base(&self, value: f64) -> f64 {
        if self.size < 1.0 { value / self.inverse() } else { value * self.size }
    }

    /// A value in the SI unit in this one.
    pub fn of_base(&self, value: f64) -> f64 {
        if self.size < 1.0 { value * self.inverse() } else { value / self.size }
    }

    /// How many make one of the SI unit; exact where that is a short decimal.
    fn inverse(&self) -> f64 {
        let inverse = 1.0 / self.size;
        let short = (inverse * DECIMALS).round() / DECIMALS;
        if (inverse - short).abs() < 1e-9 * inverse { short } else { inverse }
    }
}
