//! Numbers as text, with the digits that their uncertainty leaves: every output has the same ones.

use super::elementary;

/// Decimals that show two digits of an uncertainty of this size; four where there is none.
pub fn decimals(uncertainty: f64) -> usize {
    let is_usable = uncertainty.is_finite() && uncertainty > 0.0;
    if is_usable { (1 - elementary::log10(uncertainty).floor() as i32).clamp(0, 12) as usize } else { 4 }
}

/// Numbers from here on have an exponent: their digits would fill a line.
const MANY_DIGITS: f64 = 1e9;

/// A number with so many decimals.
pub fn rounded(v: f64, digits: usize) -> String {
    if v.abs() >= MANY_DIGITS { format!("{v:.3e}") } else { format!("{v:.digits$}") }
}

/// A value and its standard deviation: `0.877` and `0.013`.
pub fn measured_digits(value: f64, sd: f64) -> [String; 2] {
    let digits = decimals(sd);
    [value, sd].map(|v| rounded(v, digits))
}

/// The ends of an interval: `0.0790` and `0.0953`.
pub fn interval_digits(low: f64, high: f64) -> [String; 2] {
    let digits = decimals(0.5 * (high - low));
    [low, high].map(|v| rounded(v, digits))
}
