//! Parameters of effects: name, unit, bounds, and who shares a value.

/// One parameter of an effect.
#[derive(Debug, Clone, Copy)]
pub struct ParamSpec {
    pub name: &'static str,
    pub unit: &'static str,
    /// The value at which the effect is absent (of an amplitude), or a neutral one.
    pub default: f64,
    pub min: f64,
    pub max: f64,
    /// Who shares a value, unless a preset says otherwise.
    pub scope: Scope,
    pub doc: &'static str,
}

/// Who shares one value of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    Setup,
    Material,
    Shape,
    Object,
    /// Unordered pair of shapes (contact laws only).
    ShapePair,
    /// Unordered pair of objects (contact laws only).
    Pair,
}

const fn center(name: &'static str) -> ParamSpec {
    let (unit, doc) = ("m", "where it is centred");
    ParamSpec { name, unit, default: 0.0, min: -100.0, max: 100.0, scope: Scope::Setup, doc }
}

/// The place of a law that has a centre.
pub const CENTER: [ParamSpec; 2] = [center("center_x"), center("center_y")];
