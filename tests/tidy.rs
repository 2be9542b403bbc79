//! The rules of the house, as tests: imports run one way, files stay small, nothing panics on purpose.

use std::path::{Path, PathBuf};

/// Rooms from the ground up: a room may use those of lower steps only.
const STEPS: [&[&str]; 14] = [
    &["num"],
    &["scene"],
    &["body"],
    &["effects"],
    &["world"],
    &["fit"],
    &["discover", "reason"],
    &["store", "recording", "report"],
    &["engine"],
    &["api"],
    &["config"],
    &["telemetry"],
    &["cli"],
    &["lib", "main"],
];
/// Up to this step nothing knows files, clocks, tasks or wires.
const PURE: usize = 6;
const IMPURE: [&str; 7] = ["tokio", "tonic", "prost", "std::fs", "std::net", "Instant", "SystemTime"];
const MAX_LINES: usize = 550;

struct Source {
    path: PathBuf,
    room: String,
    text: String,
    /// Without tests and without comments on lines of their own.
    code: Vec<(usize, String)>,
}

fn sources() -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut folders = vec![root.clone()];
    let mut sources = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let inside = path.strip_prefix(&root).unwrap().to_path_buf();
                let room =
                    inside.iter().next().unwrap().to_string_lossy().trim_end_matches(".rs").to_string();
                let text = std::fs::read_to_string(&path).unwrap();
                let code = code(&inside, &text);
                sources.push(Source { path: inside, room, text, code });
            }
        }
    }
    assert!(sources.len() > 30, "the sources were not found");
    sources
}

/// Whether a file is `tests.rs` or in its folder.
fn of_tests(path: &Path) -> bool {
    path.ends_with("tests.rs") || path.iter().any(|part| part == "tests")
}

fn code(path: &Path, text: &str) -> Vec<(usize, String)> {
    let lines = text.lines().enumerate();
    let lines = lines.take_while(|(_, line)| !line.starts_with("#[cfg(test)]") && !of_tests(path));
    let lines = lines.filter(|(_, line)| !line.trim_start().starts_with("//"));
    lines.map(|(i, line)| (i + 1, line.to_string())).collect()
}

fn step(room: &str) -> Option<usize> {
    STEPS.iter().position(|rooms| rooms.contains(&room))
}

/// Every violation at once.
fn check(rule: &str, violations: Vec<String>) {
    assert!(violations.is_empty(), "{rule}:\n{}", violations.join("\n"));
}

#[test]
fn imports_run_one_way() {
    let mut violations = Vec::new();
    for source in sources() {
        let Some(here) = step(&source.room) else {
            violations.push(format!("{}: no room of the house", source.path.display()));
            continue;
        };
        for (number, line) in
            source.text.lines().enumerate().filter(|(_, l)| !l.trim_start().starts_with("//"))
        {
            for (at, _) in line.match_indices("crate::") {
                let name = line[at + "crate::".len()..].split(|c: char| !c.is_alphanumeric() && c != '_');
                let name = name.into_iter().next().unwrap_or_default();
                if name != source.room && step(name).is_none_or(|there| there >= here) {
                    violations.push(format!("{}:{}: uses {name}", source.path.display(), number + 1));
                }
            }
        }
    }
    check("a room uses those below it only", violations);
}

#[test]
fn the_core_is_pure() {
    let mut violations = Vec::new();
    for source in sources().iter().filter(|s| step(&s.room).is_some_and(|step| step <= PURE)) {
        for (number, line) in &source.code {
            for word in IMPURE.iter().filter(|word| line.contains(**word)) {
                violations.push(format!("{}:{number}: {word}", source.path.display()));
            }
        }
    }
    check("the core knows no files, clocks, tasks or wires", violations);
}

#[test]
fn files_are_small_and_say_their_job_first() {
    let mut violations = Vec::new();
    for source in sources() {
        let (path, lines) = (source.path.display(), source.text.lines().count());
        if lines > MAX_LINES {
            violations.push(format!("{path}: {lines} lines; split it"));
        }
        if !source.text.lines().next().unwrap_or_default().starts_with("//! ") {
            violations.push(format!("{path}: the first line must say the file's job (//!)"));
        }
    }
    check("files", violations);
}

#[test]
fn nothing_is_left_undone_and_no_panic_goes_unexplained() {
    let mut violations = Vec::new();
    for source in sources() {
        for (number, line) in &source.code {
            let undone = ["todo!", "unimplemented!", "dbg!"].iter().any(|word| line.contains(word));
            let panics = line.contains(".unwrap()") || line.contains(".expect(");
            if undone || (panics && !line.contains("//")) {
                violations.push(format!("{}:{number}: {}", source.path.display(), line.trim()));
            }
        }
    }
    check("undone, or a panic without a reason in a comment", violations);
}
