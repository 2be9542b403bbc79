//! Parameters as reports give them: vectors joined, internal amplitudes turned into the quantities of the field.

use super::param::ParamSpec;

/// A value in a report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quantity {
    Number(f64),
    Vector([f64; 2]),
    Word(&'static str),
}

/// The one rule for vectors: parameters `name_x` and `name_y`, in this order, are the vector `name`.
pub fn joined(params: &[ParamSpec], values: &[f64]) -> Vec<(&'static str, Quantity)> {
    let mut all = vec![];
    let mut rest = params.iter().zip(values).peekable();
    while let Some((p, &value)) = rest.next() {
        let stem = p.name.strip_suffix("_x");
        let second = rest.next_if(|(q, _)| stem.is_some() && q.name.strip_suffix("_y") == stem);
        all.push(match (stem, second) {
            (Some(stem), Some((_, &y))) => (stem, Quantity::Vector([value, y])),
            _ => (p.name, Quantity::Number(value)),
        });
    }
    all
}
