//! Numbers and tables for people.

use crate::num::elementary;

/// A number with four decimals, or with four significant digits if it is small.
pub fn number(v: f64) -> String {
    let digits =
        if v == 0.0 { 4 } else { (3 - elementary::log10(v.abs()).floor() as i32).clamp(4, 12) as usize };
    format!("{v:.digits$}")
}

/// A table whose columns fit their widest cell: the first left-aligned, the others right-aligned.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    let count = |s: &str| s.chars().count();
    let width = |c: usize| {
        let cells = rows.iter().filter_map(|row| row.get(c)).map(|cell| count(cell));
        cells.chain([header.get(c).map_or(0, |h| count(h))]).max().unwrap_or(0)
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
