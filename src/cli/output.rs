//! Writes results: JSON to a file or standard output, tables for people.

use super::error::Failure;
use crate::num::elementary;
use serde_json::Value;
use std::io::Write;
use std::path::Path;

/// Whether a file can be written, before the work for it is done; `-` (standard output) and devices can.
pub fn writable(flag: &str, path: &Path) -> Result<(), Failure> {
    let wrong = |why: String| Err(Failure::input(format!("{flag} {}: {why}; give a file", path.display())));
    if path == Path::new("-") {
        return Ok(());
    }
    match path.metadata() {
        Ok(found) if found.is_dir() => wrong("is a folder".into()),
        Ok(found) if found.is_file() => match std::fs::OpenOptions::new().write(true).open(path) {
            Ok(_) => Ok(()),
            Err(e) => wrong(e.to_string()),
        },
        Ok(_) => Ok(()),
        Err(_) => {
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            match tempfile::tempfile_in(folder) {
                Ok(_) if path.file_name().is_some() => Ok(()),
                Ok(_) => wrong("is no name of a file".into()),
                Err(e) => wrong(format!("{} cannot be written in: {e}", folder.display())),
            }
        }
    }
}

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

/// A line to standard error; who does not listen misses it.
pub fn tell(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// A number as a person reads it: four decimals, and of small ones four digits.
pub fn number(v: f64) -> String {
    let digits =
        if v == 0.0 { 4 } else { (3 - elementary::log10(v.abs()).floor() as i32).clamp(4, 12) as usize };
    format!("{v:.digits$}")
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
    fn what_cannot_be_written_is_found_out_before() {
        let folder = tempfile::tempdir().unwrap();
        let there = folder.path().join("there.json");
        std::fs::write(&there, b"kept").unwrap();
        for good in [there.clone(), folder.path().join("new.json"), "-".into(), "/dev/null".into()] {
            assert!(writable("--json", &good).is_ok(), "{}", good.display());
        }
        assert_eq!(std::fs::read(&there).unwrap(), b"kept");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        for bad in [folder.path().to_path_buf(), folder.path().join("no/where.json"), there.join("x")] {
            let error = writable("--json", &bad).unwrap_err();
            assert!(error.status() == 2 && error.to_string().contains("--json"), "{error}");
        }
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
