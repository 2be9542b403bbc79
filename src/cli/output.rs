//! Writes results: JSON to a file or standard output, tables for people.

use super::error::Failure;
use serde_json::Value;
use std::io::Write;
use std::path::Path;

/// Writes JSON to `target`; `-` is standard output.
pub fn json(target: &str, value: &Value) -> Result<(), Failure> {
    let mut text = value.to_string();
    text.push('\n');
    if target == "-" {
        return print(&text);
    }
    file(Path::new(target), text.as_bytes())
}

pub fn file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes).map_err(|e| Failure::other(format!("{}: {e}", path.display())))
}

/// To standard output; a reader that has left is no error.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure::other(e)),
        _ => Ok(()),
    }
}

/// Columns as wide as their widest cell: the first to the left, the others to the right.
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
