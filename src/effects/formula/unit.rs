//! Units that a formula's numbers may have: products, quotients and powers of SI symbols.

/// The symbols; numbers are in SI units, so that none has a prefix but the kilogram.
pub const SYMBOLS: [&str; 16] =
    ["1", "m", "s", "kg", "rad", "N", "Hz", "J", "W", "Pa", "A", "C", "V", "T", "K", "sr"];
/// Longest text (bytes).
const LONGEST: usize = 64;

/// Exponents of m, s, kg, A and K.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Dimension(pub [f64; 5]);

/// The base units of a dimension, in the order in which a unit is written.
const BASES: [(&str, usize); 5] = [("kg", 2), ("m", 0), ("s", 1), ("A", 3), ("K", 4)];
/// Exponents that differ by less are equal: units have small exponents.
const SAME: f64 = 1e-6;

impl Dimension {
    const fn of(m: f64, s: f64, kg: f64, ampere: f64) -> Dimension {
        Dimension([m, s, kg, ampere, 0.0])
    }

    /// Of a symbol; angles are numbers.
    fn of_symbol(symbol: &str) -> Option<Dimension> {
        Some(match symbol {
            "1" | "rad" | "sr" => Dimension::default(),
            "m" => Dimension::of(1.0, 0.0, 0.0, 0.0),
            "s" => Dimension::of(0.0, 1.0, 0.0, 0.0),
            "kg" => Dimension::of(0.0, 0.0, 1.0, 0.0),
            "N" => Dimension::of(1.0, -2.0, 1.0, 0.0),
            "Hz" => Dimension::of(0.0, -1.0, 0.0, 0.0),
            "J" => Dimension::of(2.0, -2.0, 1.0, 0.0),
            "W" => Dimension::of(2.0, -3.0, 1.0, 0.0),
            "Pa" => Dimension::of(-1.0, -2.0, 1.0, 0.0),
            "A" => Dimension::of(0.0, 0.0, 0.0, 1.0),
            "C" => Dimension::of(0.0, 1.0, 0.0, 1.0),
            "V" => Dimension::of(2.0, -3.0, 1.0, -1.0),
            "T" => Dimension::of(0.0, -2.0, 1.0, -1.0),
            "K" => Dimension([0.0, 0.0, 0.0, 0.0, 1.0]),
            _ => return None,
        })
    }

    /// This times the power of another.
    pub fn times(mut self, other: Dimension, power: f64) -> Dimension {
        self.0.iter_mut().zip(other.0).for_each(|(a, b)| *a += power * b);
        self
    }

    pub fn power(self, power: f64) -> Dimension {
        Dimension::default().times(self, power)
    }

    pub fn is_number(&self) -> bool {
        self.0.iter().all(|e| e.abs() < SAME)
    }

    /// As a unit, such as `kg m/s^2` or `1/(kg m)`.
    pub fn text(&self) -> String {
        let part = |sign: f64| -> Vec<String> {
            let power = |(symbol, k): &(&str, usize)| {
                let e = sign * self.0.get(*k).copied().unwrap_or(0.0);
                let e = (1e3 * e).round() / 1e3;
                (e > SAME).then(|| if e == 1.0 { symbol.to_string() } else { format!("{symbol}^{e}") })
            };
            BASES.iter().filter_map(power).collect()
        };
        let (above, below) = (part(1.0).join(" "), part(-1.0));
        let above = if above.is_empty() { "1" } else { &above };
        match &below[..] {
            [] => above.into(),
            [one] => format!("{above}/{one}"),
            several => format!("{above}/({})", several.join(" ")),
        }
    }
}

/// The dimension of a unit, such as `1/m`, `N s/m`, `kg*m^2` or `(m/N)^0.5`; `None` if it is no unit.
pub fn dimension(text: &str) -> Option<Dimension> {
    let mut rest = text.trim();
    let found = if text.len() <= LONGEST { product(&mut rest) } else { None };
    found.filter(|_| rest.is_empty())
}

/// Whether it is a unit.
pub fn is_unit(text: &str) -> bool {
    dimension(text).is_some()
}

/// Factors parted by `*`, `/` or a blank, which multiplies.
fn product(rest: &mut &str) -> Option<Dimension> {
    let (mut all, mut sign) = (Dimension::default(), 1.0);
    loop {
        all = all.times(factor(rest)?, sign);
        let after = rest.trim_start();
        let blank = after.len() < rest.len();
        sign = if after.starts_with('/') { -1.0 } else { 1.0 };
        *rest = match after.strip_prefix(['*', '/', '·']) {
            Some(next) => next.trim_start(),
            None if blank && !after.is_empty() && !after.starts_with(')') => after,
            None => {
                *rest = after;
                return Some(all);
            }
        };
    }
}

fn factor(rest: &mut &str) -> Option<Dimension> {
    let base = match rest.strip_prefix('(') {
        Some(inner) => {
            *rest = inner.trim_start();
            let inside = product(rest)?;
            *rest = rest.strip_prefix(')')?;
            inside
        }
        None => {
            let end = rest.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(rest.len());
            let (symbol, after) = rest.split_at(end);
            *rest = after;
            Dimension::of_symbol(symbol)?
        }
    };
    Some(base.power(power(rest)?))
}

/// Nothing, or `^` and a number.
fn power(rest: &mut &str) -> Option<f64> {
    let Some(after) = rest.strip_prefix('^') else { return Some(1.0) };
    let unsigned = after.strip_prefix('-').unwrap_or(after);
    let end = unsigned.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(unsigned.len());
    let (number, after_number) = unsigned.split_at(end);
    *rest = after_number;
    let value = number.parse::<f64>().ok()?;
    Some(if unsigned.len() < after.len() { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::EFFECTS;
    use proptest::prelude::*;

    #[test]
    fn units_are_made_of_known_symbols() {
        for text in
            ["1", "kg", "1/m", "m/s^2", "N s/m", "N m^2", " kg * m^2 / s ", "(m/N)^0.5", "s^-1", "1/(kg m)"]
        {
            assert!(is_unit(text), "{text}");
        }
        for text in
            ["", "banana", "m/", "/m", "m s)", "(m", "m^", "m^x", "m2", "mm", "m//s", "m^1.2.3", "kg banana"]
        {
            assert!(!is_unit(text), "{text}");
        }
        assert!(!is_unit(&"(".repeat(9_999)) && !is_unit(&"m ".repeat(99)));
    }

    #[test]
    fn a_unit_has_a_dimension_and_a_dimension_a_unit() {
        let again = |text: &str| dimension(text).map(|d| d.text());
        for (given, base) in [
            ("1", "1"),
            ("N", "kg m/s^2"),
            ("N s/m", "kg/s"),
            ("1/(kg m)", "1/(kg m)"),
            ("(m/N)^0.5", "s/kg^0.5"),
            ("rad/s", "1/s"),
            ("m/s/s", "m/s^2"),
            ("V/A", "kg m^2/(s^3 A^2)"),
        ] {
            assert_eq!(again(given).as_deref(), Some(base), "{given}");
            assert_eq!(dimension(base), dimension(given), "{given}");
        }
    }

    #[test]
    fn every_unit_of_the_catalogue_is_one() {
        for p in EFFECTS.iter().flat_map(|e| e.spec.params) {
            assert!(is_unit(p.unit), "{}: {}", p.name, p.unit);
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[()mskgN1^*/ .é²-]{0,20}") {
            let _ = is_unit(&text);
        }
    }
}
