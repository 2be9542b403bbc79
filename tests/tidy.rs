//! The rules of the house, as tests: imports run one way and in no circle, names are unique, functions have one job,
//! effects are named by their own files only, and a private language stays out.
//!
//! The inside of `discover` is rebuilt later; [`EXEMPT`] names it, and the rules that apply there say so.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Rooms from the ground up: a room may use those of lower steps only.
const STEPS: [&[&str]; 15] = [
    &["num"],
    &["scene", "media"],
    &["body", "perception"],
    &["effects"],
    &["world"],
    &["fit"],
    &["discover", "reason"],
    &["concepts"],
    &["store", "recording", "report"],
    &["engine"],
    &["api"],
    &["config"],
    &["telemetry"],
    &["cli"],
    &["lib", "main"],
];
/// Up to this step nothing knows files, clocks, tasks or wires.
const PURE: usize = 7;
const IMPURE: [&str; 7] = ["tokio", "tonic", "prost", "std::fs", "std::net", "Instant", "SystemTime"];
/// The one room whose inside keeps its language and its shape until it is rebuilt.
const EXEMPT: &str = "discover";
const MAX_FILES: usize = 15;
const MAX_FUNCTION_LINES: usize = 70;
const MAX_ARGUMENTS: usize = 6;

/// Words of the private language that the project once had; whole words, in names as in sentences.
const FORBIDDEN: [&str; 50] = [
    "told",
    "hear",
    "hears",
    "heard",
    "hearing",
    "foretell",
    "foretells",
    "foretold",
    "foretelling",
    "believe",
    "believed",
    "believes",
    "begun",
    "anew",
    "astray",
    "whirl",
    "whirls",
    "blow",
    "blows",
    "lean",
    "leans",
    "leaning",
    "film",
    "films",
    "filmed",
    "filming",
    "stray",
    "strays",
    "struck",
    "stretch",
    "stretches",
    "stretched",
    "swift",
    "hurry",
    "hurries",
    "hurried",
    "jam",
    "jams",
    "jammed",
    "cling",
    "clings",
    "clinging",
    "shelf",
    "shelves",
    "comings",
    "goings",
    "rub",
    "rubs",
    "untold",
    "unheard",
];
const FORBIDDEN_PHRASES: [&str; 3] = ["borne out", "set aside", "sets aside"];
/// Functions of statistics and numerics of which the crate has one each, in `num`.
const ONLY_IN_NUM: [&str; 5] = ["median", "quantile", "hermite", "levenberg_marquardt", "standard_normal"];

/// Names of effects that are words for other things too (an object's restitution in results, a CSS class), and the rooms
/// that mean those.
const ALSO_WORDS: [&str; 2] = ["restitution", "cushion"];
const WORDY_ROOMS: [&str; 3] = ["reason", "report", "cli"];

struct Source {
    /// Inside `src`.
    path: PathBuf,
    room: String,
    text: String,
    /// Without tests and without comments on lines of their own.
    code: Vec<(usize, String)>,
}

impl Source {
    fn is_exempt(&self) -> bool {
        self.room == EXEMPT
    }
    fn at(&self, line: usize) -> String {
        format!("src/{}:{line}", self.path.display())
    }
    fn is_test(&self) -> bool {
        of_tests(&self.path)
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files below a folder whose names end so.
fn files_below(folder: &Path, ends: &[&str]) -> Vec<PathBuf> {
    let mut folders = vec![folder.to_path_buf()];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().to_string();
            if path.is_dir()
                && !name.starts_with('.')
                && !["target", "data", "build"].contains(&name.as_str())
            {
                folders.push(path);
            } else if ends.iter().any(|end| name.ends_with(end)) {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

fn sources() -> Vec<Source> {
    let src = root().join("src");
    let sources: Vec<Source> = files_below(&src, &[".rs"])
        .into_iter()
        .map(|path| {
            let inside = path.strip_prefix(&src).unwrap().to_path_buf();
            let room = inside.iter().next().unwrap().to_string_lossy().trim_end_matches(".rs").to_string();
            let text = std::fs::read_to_string(&path).unwrap();
            let code = code(&inside, &text);
            Source { path: inside, room, text, code }
        })
        .collect();
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

/// The word (letters, digits, underscores) at the start of a text.
fn word(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

/// Every violation at once.
fn check(rule: &str, violations: impl IntoIterator<Item = String>) {
    let violations: Vec<String> = violations.into_iter().collect();
    assert!(violations.is_empty(), "{rule} ({}):\n{}", violations.len(), violations.join("\n"));
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
                let name = word(&line[at + "crate::".len()..]);
                if name != source.room && step(name).is_none_or(|there| there >= here) {
                    violations.push(format!("{}: uses {name}", source.at(number + 1)));
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
                violations.push(format!("{}: {word}", source.at(*number)));
            }
        }
    }
    check("the core knows no files, clocks, tasks or wires", violations);
}

#[test]
fn a_file_says_its_job_first() {
    let silent = sources().into_iter().filter(|s| !s.text.starts_with("//! "));
    check("the first line must say the file's job (//!)", silent.map(|s| s.path.display().to_string()));
}

#[test]
fn nothing_is_left_undone_and_no_panic_goes_unexplained() {
    let mut violations = Vec::new();
    for source in sources() {
        for (number, line) in &source.code {
            let undone = ["todo!", "unimplemented!", "dbg!"].iter().any(|word| line.contains(word));
            let panics = line.contains(".unwrap()") || line.contains(".expect(");
            if undone || (panics && !line.contains("//")) {
                violations.push(format!("{}: {}", source.at(*number), line.trim()));
            }
        }
    }
    check("undone, or a panic without a reason in a comment", violations);
}

/// A line's words: names are taken apart at underscores and capitals.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut before = ' ';
    for c in line.chars() {
        if !c.is_ascii_alphabetic() || (c.is_ascii_uppercase() && before.is_ascii_lowercase()) {
            words.push(String::new());
        }
        if c.is_ascii_alphabetic() {
            words.last_mut().unwrap().push(c.to_ascii_lowercase());
        }
        before = c;
    }
    words.retain(|word| !word.is_empty());
    words
}

#[test]
fn a_private_language_stays_out() {
    let mut files: Vec<PathBuf> =
        ["src", "proto", "tests", "benches", "examples", "clients", "deploy", "docs"]
            .iter()
            .map(|folder| root().join(folder))
            .filter(|folder| folder.is_dir())
            .flat_map(|folder| {
                files_below(&folder, &[".rs", ".proto", ".py", ".md", ".js", ".css", ".yaml", ".sh"])
            })
            .collect();
    files.extend(["README.md", "ARCHITECTURE.md", "CHANGELOG.md", "build.rs"].map(|file| root().join(file)));
    let list = ["tests/tidy.rs", "tests/docs.rs"].map(|file| root().join(file));
    let inside = root().join("src").join(EXEMPT);
    let mut violations = Vec::new();
    for path in files.into_iter().filter(|path| !list.contains(path) && !path.starts_with(&inside)) {
        let text = std::fs::read_to_string(&path).unwrap();
        // A stored key keeps its name: older data must stay readable.
        let is_key = |line: &str| line.trim_start().starts_with("#[serde(rename = ");
        for (number, line) in text.lines().enumerate().filter(|(_, line)| !is_key(line)) {
            let lower = line.to_lowercase();
            let found = words(line).into_iter().filter(|word| FORBIDDEN.contains(&word.as_str()));
            let phrases = FORBIDDEN_PHRASES.iter().filter(|phrase| lower.contains(**phrase));
            for word in found.chain(phrases.map(|phrase| phrase.to_string())) {
                violations.push(format!(
                    "{}:{}: {word}",
                    path.strip_prefix(root()).unwrap().display(),
                    number + 1
                ));
            }
        }
    }
    check("words that a newcomer would not know; language: the field's standard terms", violations);
}

#[test]
fn no_type_name_twice() {
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for source in sources().iter().filter(|s| !s.is_exempt()) {
        for (number, line) in &source.code {
            // An indented `type` is associated with a trait.
            let is_top = !line.starts_with(' ');
            let line = line.trim_start();
            let line = ["pub(crate) ", "pub(super) ", "pub "]
                .iter()
                .find_map(|p| line.strip_prefix(p))
                .unwrap_or(line);
            let alias = line.strip_prefix("type ").filter(|_| is_top);
            let kinds =
                ["struct ", "enum ", "trait ", "union "].iter().find_map(|kind| line.strip_prefix(kind));
            if let Some(rest) = kinds.or(alias) {
                places.entry(word(rest).to_string()).or_default().push(source.at(*number));
            }
        }
    }
    let twice = places.into_iter().filter(|(_, places)| places.len() > 1);
    check(
        "a type name twice in the crate",
        twice.map(|(name, places)| format!("{name}: {}", places.join(", "))),
    );
}

#[test]
fn no_constant_with_two_values_in_a_room() {
    let mut values: BTreeMap<(String, String), BTreeSet<String>> = BTreeMap::new();
    for source in sources().iter().filter(|s| !s.is_exempt()) {
        let code: String = source.code.iter().map(|(_, line)| format!("{line}\n")).collect();
        for (at, _) in code.match_indices("const ") {
            let rest = &code[at + "const ".len()..];
            let name = word(rest);
            let before = code[..at].lines().last().unwrap_or_default().trim();
            let is_item =
                !name.is_empty() && name == name.to_uppercase() && rest[name.len()..].starts_with(':');
            if is_item
                && ["", "pub", "pub(crate)", "pub(super)"].contains(&before)
                && code[..at].ends_with('\n')
                || is_item && before.starts_with("pub")
            {
                let value =
                    rest.split(';').next().unwrap_or_default().split_once(" = ").unwrap_or_default().1;
                let value = value.split_whitespace().collect::<String>();
                values.entry((source.room.clone(), name.to_string())).or_default().insert(value);
            }
        }
    }
    let two = values.into_iter().filter(|(_, values)| values.len() > 1);
    check(
        "a constant's name with two values in a room",
        two.map(|((room, name), v)| format!("{room}: {name} {v:?}")),
    );
}

#[test]
fn folders_are_small() {
    let mut counts: BTreeMap<PathBuf, usize> = BTreeMap::new();
    for source in sources().iter().filter(|s| !s.is_exempt()) {
        *counts.entry(source.path.parent().unwrap().to_path_buf()).or_default() += 1;
    }
    let large = counts.into_iter().filter(|(_, count)| *count > MAX_FILES);
    check("folders of more than 15 files", large.map(|(folder, n)| format!("src/{}: {n}", folder.display())));
}

/// Number of arguments, without `self`, of the function whose text after its name and generics begins at `(`.
fn arguments(text: &str) -> usize {
    let (mut depth, mut angle, mut current, mut arguments) = (0, 0, String::new(), Vec::new());
    let mut before = ' ';
    for c in text.chars() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            '<' => angle += 1,
            '>' if before != '-' => angle -= 1,
            _ => {}
        }
        if depth == 0 {
            break;
        }
        if c == ',' && depth == 1 && angle == 0 {
            arguments.push(std::mem::take(&mut current));
        } else {
            current.push(c);
        }
        before = c;
    }
    arguments.push(current);
    let arguments = arguments.iter().map(|a| a.trim_start_matches('(').trim());
    arguments.filter(|a| !a.is_empty() && !a.ends_with("self")).count()
}

#[test]
fn functions_have_one_job() {
    let mut violations = Vec::new();
    for source in sources().iter().filter(|s| !s.is_exempt()) {
        for (k, (number, line)) in source.code.iter().enumerate() {
            let Some(at) = line.find("fn ").filter(|&at| at == 0 || line[..at].ends_with([' ', '('])) else {
                continue;
            };
            let (name, indent) = (word(&line[at + 3..]), line.len() - line.trim_start().len());
            if name.is_empty() || line.trim_start().starts_with("//") {
                continue;
            }
            let text: String =
                source.code[k..].iter().take(30).map(|(_, line)| format!("{line}\n")).collect();
            let signature = &text[at + 3 + name.len()..];
            let count = signature.find('(').map_or(0, |open| arguments(&signature[open..]));
            if count > MAX_ARGUMENTS {
                violations.push(format!("{}: {name} takes {count} arguments", source.at(*number)));
            }
            let end =
                source.code[k..].iter().find(|(_, l)| l.starts_with(&format!("{}}}", " ".repeat(indent))));
            let is_declaration = source.code[k..].iter().find(|(_, l)| l.ends_with(['{', ';', '}']));
            if let (Some((end, _)), Some((_, first))) = (end, is_declaration) {
                let lines = end - number + 1;
                if !first.ends_with([';', '}']) && lines > MAX_FUNCTION_LINES {
                    violations.push(format!("{}: {name} has {lines} lines", source.at(*number)));
                }
            }
        }
    }
    check("functions of more than 70 lines or 6 arguments", violations);
}

/// The module of a file: `world/contact/mod.rs` is `world::contact`.
fn module(path: &Path) -> String {
    let mut parts: Vec<String> =
        path.iter().map(|p| p.to_string_lossy().trim_end_matches(".rs").to_string()).collect();
    if parts.last().is_some_and(|last| last == "mod") {
        parts.pop();
    }
    parts.join("::")
}

/// Every path that a `use` tree names: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn tree(prefix: &str, text: &str, out: &mut Vec<String>) {
    let mut depth = 0;
    let mut start = 0;
    let mut pieces = Vec::new();
    for (at, c) in text.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                pieces.push(&text[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    pieces.push(&text[start..]);
    for piece in pieces.into_iter().map(str::trim).filter(|piece| !piece.is_empty()) {
        match piece.split_once('{') {
            Some((head, rest)) => tree(&format!("{prefix}{head}"), rest.trim_end_matches('}'), out),
            None => out.push(format!("{prefix}{}", piece.split(" as ").next().unwrap_or_default().trim())),
        }
    }
}

/// The crate's paths that a file's code names, from the root; re-exports and `mod` lines name, they do not use.
fn used(source: &Source, modules: &BTreeSet<String>) -> Vec<(bool, String)> {
    let here = module(&source.path);
    let code: String = source
        .code
        .iter()
        .map(|(_, l)| format!("{}\n", l.split(" // ").next().unwrap_or_default()))
        .collect();
    let absolute = |path: &str| -> Option<String> {
        let path = path.trim_start_matches("self::");
        if let Some(rest) = path.strip_prefix("crate::") {
            return Some(rest.to_string());
        }
        let (mut base, mut rest, mut ups) = (here.clone(), path, 0);
        while let Some(after) = rest.strip_prefix("super::") {
            (rest, ups) = (after, ups + 1);
            base = base.rsplit_once("::").map_or(String::new(), |(b, _)| b.to_string());
        }
        let child = format!("{base}::{}", word(rest));
        (ups > 0 || modules.contains(&child)).then(|| format!("{base}::{rest}"))
    };
    let mut out = Vec::new();
    let mut rest = String::new();
    for item in code.split_inclusive(';') {
        let start = item.rfind("\nuse ").or(item.rfind("\npub use ")).or(item.rfind("\npub(crate) use "));
        let start = start
            .or(item.rfind("\npub(super) use "))
            .map(|at| at + 1)
            .or(item.starts_with("use ").then_some(0));
        match start {
            Some(at) => {
                let public = item[at..].starts_with("pub");
                let text = item[at..].split_once("use ").unwrap_or_default().1.trim_end_matches(';');
                let mut paths = Vec::new();
                tree("", text, &mut paths);
                out.extend(paths.iter().filter_map(|path| absolute(path)).map(|path| (public, path)));
                rest.push_str(&item[..at]);
            }
            None => rest.push_str(item),
        }
    }
    let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    for piece in rest.split(|c: char| !is_path(c)).filter(|piece| piece.contains("::")) {
        out.extend(absolute(piece).map(|path| (false, path)));
    }
    out
}

/// The file that defines what a path names, through re-exports.
fn target(path: &str, modules: &BTreeSet<String>, exports: &BTreeMap<String, String>) -> Option<String> {
    let mut path = path.to_string();
    for _ in 0..5 {
        let mut deepest = path.clone();
        while !modules.contains(&deepest) {
            deepest = deepest.rsplit_once("::")?.0.to_string();
        }
        let name = word(path[deepest.len()..].trim_start_matches("::")).to_string();
        match exports.get(&format!("{deepest}::{name}")) {
            Some(next) if *next != path => path = next.clone(),
            _ => return Some(deepest),
        }
    }
    None
}

#[test]
fn no_circle_inside_a_room() {
    let sources: Vec<Source> = sources().into_iter().filter(|s| !s.is_exempt() && !s.is_test()).collect();
    let modules: BTreeSet<String> = sources.iter().map(|s| module(&s.path)).collect();
    let uses: Vec<(String, Vec<(bool, String)>)> =
        sources.iter().map(|s| (module(&s.path), used(s, &modules))).collect();
    let mut exports = BTreeMap::new();
    for (here, paths) in &uses {
        for (_, path) in paths.iter().filter(|(public, _)| *public) {
            let name = path.rsplit("::").next().unwrap_or_default();
            exports.insert(format!("{here}::{name}"), path.clone());
        }
    }
    let room = |module: &str| word(module).to_string();
    let mut edges: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (here, paths) in &uses {
        for (_, path) in paths.iter().filter(|(public, _)| !public) {
            let Some(there) = target(path, &modules, &exports) else { continue };
            if there != *here && room(&there) == room(here) {
                edges.entry(here.clone()).or_default().insert(there);
            }
        }
    }
    let reach = |from: &str| -> BTreeSet<String> {
        let (mut seen, mut queue) = (BTreeSet::new(), vec![from.to_string()]);
        while let Some(at) = queue.pop() {
            for next in edges.get(&at).into_iter().flatten() {
                if seen.insert(next.clone()) {
                    queue.push(next.clone());
                }
            }
        }
        seen
    };
    let reached: BTreeMap<&String, BTreeSet<String>> = edges.keys().map(|at| (at, reach(at))).collect();
    let mut violations = Vec::new();
    for (here, _) in reached.iter().filter(|(here, all)| all.contains(**here)) {
        let back = edges[*here].iter().filter(|next| reached.get(next).is_some_and(|r| r.contains(*here)));
        violations.push(format!("{here} -> {}", back.cloned().collect::<Vec<_>>().join(", ")));
    }
    check("files of a room use each other in a circle", violations);
}

#[test]
fn effects_are_named_by_their_own_files() {
    let sources = sources();
    let mut names = BTreeSet::new();
    for source in sources.iter().filter(|s| s.room == "effects") {
        let code: String = source.code.iter().map(|(_, line)| format!("{line}\n")).collect();
        for (at, _) in code.match_indices("EffectSpec {") {
            let name = code[at..].split_once("name: \"").map(|(_, rest)| word(rest).to_string());
            names.extend(name);
        }
    }
    assert!(names.len() > 25, "the effects were not found: {names:?}");
    let mut violations = Vec::new();
    for source in sources.iter().filter(|s| s.room != "effects" && !s.path.ends_with("preset.rs")) {
        for (number, line) in &source.code {
            for (at, _) in line.match_indices('"') {
                let name = word(&line[at + 1..]);
                let after = line[at + 1 + name.len()..].chars().next().unwrap_or(' ');
                let is_word = ALSO_WORDS.contains(&name) && WORDY_ROOMS.contains(&source.room.as_str());
                if names.contains(name) && !is_word && ['"', '.'].contains(&after) {
                    violations.push(format!("{}: \"{name}\"", source.at(*number)));
                }
            }
        }
    }
    check("an effect named outside src/effects and the presets", violations);
}

#[test]
fn numerics_are_written_once() {
    let mut violations = Vec::new();
    for source in sources().iter().filter(|s| s.room != "num") {
        for (number, line) in &source.code {
            let name = line.find("fn ").map(|at| word(&line[at + 3..])).unwrap_or_default();
            if ONLY_IN_NUM.contains(&name) {
                violations.push(format!("{}: {name}", source.at(*number)));
            }
        }
    }
    check("a function that `num` has", violations);
}
