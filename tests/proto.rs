//! Rules of the interface, over the text of `proto/vrdp/v1`: everything has a comment, every number says its unit, and
//! what clients were once given stays as it is.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What a comment of a number may say of its unit or range; whole words.
const UNITS: [&str; 24] = [
    "m",
    "m/s",
    "m^2",
    "rad",
    "rad/s",
    "s",
    "1/s",
    "kg",
    "N s",
    "J",
    "px",
    "nats",
    "0 to 1",
    "1 is noise",
    "-1 to 1",
    "plain number",
    "`unit`",
    "standard deviations",
    "95 %",
    "1e9",
    "up to 1",
    "0.001 to 1000",
    "each component",
    "at least 0",
];
/// Every message, field, method and value that clients may use.
const PROMISE: &str = "proto/v1.txt";

/// One declaration of a file.
struct Item {
    file: String,
    /// Such as `Video.fps` or `Models.GetModel`.
    path: String,
    /// Without comment, options and braces; empty for a message, an enumeration, a service and a `oneof`.
    declaration: String,
    comment: String,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn files() -> Vec<(String, String)> {
    let folder = root().join("proto/vrdp/v1");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|end| end == "proto"));
    paths.sort();
    assert!(paths.len() >= 8, "the files were not found");
    let read = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy().to_string();
        (name, std::fs::read_to_string(path).unwrap())
    };
    paths.iter().map(read).collect()
}

/// The word at the start of a text.
fn word(text: &str) -> &str {
    text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').next().unwrap_or_default()
}

/// All declarations of a file, which has one a line, and a comment only on lines of its own.
fn items(file: &str, text: &str) -> Vec<Item> {
    let (mut items, mut scopes, mut comment) = (vec![], Vec::<Option<String>>::new(), String::new());
    for line in text.lines().map(str::trim) {
        if let Some(text) = line.strip_prefix("//") {
            comment += text;
            continue;
        }
        let scope: Vec<&str> = scopes.iter().flatten().map(String::as_str).collect();
        let path = |name: &str| [&scope[..], &[name]].concat().join(".");
        let item = |path, declaration: &str| {
            let (file, declaration, comment) = (file.into(), declaration.into(), comment.clone());
            Item { file, path, declaration, comment }
        };
        let opened = ["message ", "enum ", "service ", "oneof "]
            .iter()
            .find_map(|kind| line.strip_prefix(kind).map(|rest| (*kind, word(rest))));
        if let Some((kind, name)) = opened {
            items.push(item(path(name), ""));
            if !line.ends_with('}') {
                // A `oneof` names no scope: its fields are those of the message.
                scopes.push((kind != "oneof ").then(|| name.to_string()));
            }
        } else if let Some(method) = line.strip_prefix("rpc ") {
            items.push(item(path(word(method)), method.trim_end_matches(';')));
        } else if line.starts_with('}') {
            scopes.pop();
        } else if !scopes.is_empty() && line.contains(" = ") && line.ends_with(';') {
            let declaration = line.trim_end_matches(';');
            let name =
                declaration.split(" = ").next().unwrap_or_default().rsplit(' ').next().unwrap_or_default();
            items.push(item(path(name), declaration));
        }
        comment.clear();
    }
    items
}

fn all() -> Vec<Item> {
    let items: Vec<Item> = files().iter().flat_map(|(file, text)| items(file, text)).collect();
    assert!(items.len() > 400, "the declarations were not found");
    items
}

fn check(rule: &str, violations: impl IntoIterator<Item = String>) {
    let violations: Vec<String> = violations.into_iter().collect();
    assert!(violations.is_empty(), "{rule} ({}):\n{}", violations.len(), violations.join("\n"));
}

fn at(item: &Item) -> String {
    format!("{}: {}", item.file, item.path)
}

fn uncommented(items: &[Item]) -> Vec<String> {
    items.iter().filter(|item| item.comment.trim().is_empty()).map(at).collect()
}

fn without_unit(items: &[Item]) -> Vec<String> {
    let is_number = |i: &&Item| {
        let mut words = i.declaration.split(' ').filter(|w| !["repeated", "optional"].contains(w));
        words.next().is_some_and(|kind| ["double", "float"].contains(&kind))
    };
    let says = |comment: &str, unit: &str| {
        let part_of_word = |c: char| c.is_ascii_alphanumeric() || "_/^-".contains(c);
        comment.match_indices(unit).any(|(at, _)| {
            !comment[..at].ends_with(part_of_word) && !comment[at + unit.len()..].starts_with(part_of_word)
        })
    };
    let silent = |i: &&Item| !UNITS.iter().any(|unit| says(&i.comment, unit));
    items.iter().filter(is_number).filter(silent).map(at).collect()
}

#[test]
fn everything_has_a_comment_and_every_number_its_unit_or_range() {
    check("no comment", uncommented(&all()));
    check("a number without unit or range; say which", without_unit(&all()));
    let bad = "// A thing.\nmessage A {\n  double x = 1;\n  // As long as it is.\n  double y = 2;\n}\n";
    let found = items("bad", bad);
    assert_eq!((uncommented(&found), without_unit(&found).len()), (vec!["bad: A.x".to_string()], 2));
}

#[test]
fn files_name_their_packages_in_other_languages() {
    let lacking = |(file, text): &(String, String)| {
        let options =
            ["go_package = \"vrdp/v1;vrdpv1\"", "java_package = \"vrdp.v1\"", "java_multiple_files = true"];
        let absent = options.into_iter().filter(|option| !text.contains(&format!("option {option};")));
        absent.map(|option| format!("{file}: option {option};")).collect::<Vec<_>>()
    };
    check("an option is missing", files().iter().flat_map(lacking));
}

#[test]
fn what_clients_use_stays() {
    let listed = std::fs::read_to_string(root().join(PROMISE)).unwrap();
    let listed: BTreeSet<String> = listed.lines().map(String::from).collect();
    let line = |i: Item| format!("{} {}", i.path, i.declaration).trim().to_string();
    let now: BTreeSet<String> = all().into_iter().map(line).collect();
    check("changed or removed, which breaks clients: keep these", listed.difference(&now).cloned());
    check(&format!("new: add these lines to {PROMISE}"), now.difference(&listed).cloned());
}
