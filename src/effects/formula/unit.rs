//! Units that a formula's numbers may have: products, quotients and powers of SI symbols.

/// The symbols; numbers are in SI units, so that none has a prefix but the kilogram.
pub const SYMBOLS: [&str; 16] =
    ["1", "m", "s", "kg", "rad", "N", "Hz", "J", "W", "Pa", "A", "C", "V", "T", "K", "sr"];
/// Longest text (bytes).
const LONGEST: usize = 64;

/// Whether it is a unit, such as `1/m`, `N s/m`, `kg*m^2` or `(m/N)^0.5`.
pub fn is_unit(text: &str) -> bool {
    let mut rest = text.trim();
    text.len() <= LONGEST && product(&mut rest) && rest.is_empty()
}

/// Factors parted by `*`, `/` or a blank, which multiplies.
fn product(rest: &mut &str) -> bool {
    while factor(rest) {
        let after = rest.trim_start();
        let blank = after.len() < rest.len();
        *rest = match after.strip_prefix(['*', '/', '·']) {
            Some(next) => next.trim_start(),
            None if blank && !after.is_empty() && !after.starts_with(')') => after,
            None => {
                *rest = after;
                return true;
            }
        };
    }
    false
}

fn factor(rest: &mut &str) -> bool {
    let base = match rest.strip_prefix('(') {
        Some(inner) => {
            *rest = inner.trim_start();
            let inside = product(rest);
            match rest.strip_prefix(')') {
                Some(after) if inside => *rest = after,
                _ => return false,
            }
            true
        }
        None => {
            let end = rest.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(rest.len());
            let (symbol, after) = rest.split_at(end);
            *rest = after;
            SYMBOLS.contains(&symbol)
        }
    };
    base && power(rest)
}

/// Nothing, or `^` and a number.
fn power(rest: &mut &str) -> bool {
    let Some(after) = rest.strip_prefix('^') else { return true };
    let signed = after.strip_prefix('-').unwrap_or(after);
    let end = signed.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(signed.len());
    let (number, after) = signed.split_at(end);
    *rest = after;
    number.parse::<f64>().is_ok()
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
