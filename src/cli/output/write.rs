//! Writes results: JSON to a file or standard output, tables for people.

use super::assumptions;
use crate::cli::error::Failure;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// Checks, before the work starts, that a file can be written; `-` (standard output) and devices always can.
pub fn writable(flag: &str, path: &Path) -> Result<(), Failure> {
    let wrong =
        |why: String| Err(Failure::input(format!("{flag} {}: {why}; give a writable file", path.display())));
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
                Ok(_) => wrong("is not a file name".into()),
                Err(e) => wrong(format!("cannot write to the folder {}: {e}", folder.display())),
            }
        }
    }
}

/// Prints the text, and writes the JSON beside it if a file is named; `-` puts the JSON in the text's place.
/// Both state what was assumed of the scenes, and what their tracks show of how they were measured.
pub fn result(json_file: Option<&str>, text: &str, value: impl FnOnce() -> Value) -> Result<(), Failure> {
    result_with(&assumptions::lines(), json_file, text, value)
}

/// Key in the JSON and heading in the text.
const HEADINGS: [(&str, &str); 2] =
    [("assumed", "assumed, as the files do not state it:"), ("tracks_show", "how the tracks look:")];

fn result_with(
    lines: &[Vec<String>; 2],
    json_file: Option<&str>,
    text: &str,
    value: impl FnOnce() -> Value,
) -> Result<(), Failure> {
    let said = || HEADINGS.iter().zip(lines).filter(|(_, lines)| !lines.is_empty());
    if let Some(file) = json_file {
        let mut value = value();
        if let Some(object) = value.as_object_mut() {
            said().for_each(|((key, _), lines)| _ = object.insert(key.to_string(), json!(lines)));
        }
        self::json(file, &value)?;
    }
    let block = |((_, heading), lines): (&(&str, &str), &Vec<String>)| {
        format!("{heading}\n{}", lines.iter().map(|line| format!("  {line}\n")).collect::<String>())
    };
    let before: String = said().map(block).collect();
    if json_file == Some("-") { Ok(()) } else { print(&format!("{before}{text}")) }
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

/// Writes to standard output; a closed pipe is not an error.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure::other(e)),
        _ => Ok(()),
    }
}

/// Writes a line to standard error; ignores errors.
pub fn tell(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_stands_beside_the_text() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.json");
        let written = |assumed: &[String]| {
            result_with(&[assumed.to_vec(), vec![]], file.to_str(), "", || json!({ "mass": 1.5 })).unwrap();
            std::fs::read_to_string(&file).unwrap()
        };
        assert_eq!(written(&[]), "{\"mass\":1.5}\n");
        assert_eq!(written(&["25 fps".into()]), "{\"assumed\":[\"25 fps\"],\"mass\":1.5}\n");
    }

    #[test]
    fn unwritable_files_are_refused() {
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
}
