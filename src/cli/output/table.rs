//! Numbers and tables for people.

use crate::num::{decimals, elementary, interval_digits, measured_digits, rounded};

/// Numbers from here on have an exponent, as their digits would say little.
const MANY_DIGITS: f64 = 1e9;

/// A number with four decimals, or with four significant digits if it is small.
pub fn number(v: f64) -> String {
    if v.abs() >= MANY_DIGITS {
        return format!("{v:.3e}");
    }
    let digits =
        if v == 0.0 { 4 } else { (3 - elementary::log10(v.abs()).floor() as i32).clamp(4, 12) as usize };
    format!("{v:.digits$}")
}

/// A value with its standard deviation: `0.877 ± 0.013`.
pub fn measured(value: f64, sd: f64) -> String {
    measured_digits(value, sd).join(" ± ")
}

/// The same in short: `0.877(13)`, the standard deviation in units of the last digit.
pub fn concise(value: f64, sd: f64) -> String {
    let digits = decimals(sd);
    let last = format!("{sd:.digits$}").replace('.', "");
    format!("{value:.digits$}({})", last.trim_start_matches('0'))
}

/// An interval: `[0.0790 to 0.0953]`.
pub fn interval(low: f64, high: f64) -> String {
    format!("[{}]", interval_digits(low, high).join(" to "))
}

/// A value with its interval: `0.0872 [0.0790 to 0.0953]`.
pub fn with_interval(value: f64, low: f64, high: f64) -> String {
    let digits = decimals(0.5 * (high - low));
    format!("{} {}", rounded(value, digits), interval(low, high))
}

/// Widest column that cells are aligned in (characters).
const WIDEST: usize = 200;

/// A table whose columns fit their widest cell: the first left-aligned, the others right-aligned.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    let count = |s: &str| s.chars().count();
    let width = |c: usize| {
        let cells = rows.iter().filter_map(|row| row.get(c)).map(|cell| count(cell));
        cells.chain([header.get(c).map_or(0, |h| count(h))]).max().unwrap_or(0).min(WIDEST)
    };
    let widths: Vec<usize> = (0..header.len()).map(width).collect();
    let line = |cells: &[String]| {
        let cells = cells.iter().zip(&widths).enumerate().map(|(i, (cell, &width))| match i {
            0 => format!("{cell:<width$}"),
            _ => format!("{cell:>width$}"),
        });
        format!("  {}\n", cells.collect::<Vec<_>>().join("  ").trim_end())
    };
    let header: Vec<String> = header.iter().map(|h| h.to_string()).collect();
    let rule =
        format!("  {}\n", "─".repeat(widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1)));
    line(&header) + &rule + &rows.iter().map(|row| line(row)).collect::<String>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_the_digits_that_its_uncertainty_leaves() {
        assert_eq!(measured(0.877_312, 0.013_449), "0.877 ± 0.013");
        assert_eq!([concise(0.172_4, 0.013), concise(1234.5, 56.0)], ["0.172(13)", "1234(56)"]);
        assert_eq!(measured(1234.5, 56.0), "1234 ± 56");
        assert_eq!(measured(1e300, 2e299), "1.000e300 ± 2.000e299");
        assert_eq!(measured(2.0, 0.0), "2.0000 ± 0.0000");
        assert_eq!(with_interval(-0.000_084_6, -0.000_572, 0.000_402_8), "-0.00008 [-0.00057 to 0.00040]");
    }

    #[test]
    fn columns_line_up() {
        let rows = [vec!["µ".to_string(), "1.25".into()], vec!["mass".into(), "2".into()]];
        insta::assert_snapshot!(table(&["what", "value"], &rows), @r"
          what  value
          ───────────
          µ      1.25
          mass      2
        ");
    }
}
