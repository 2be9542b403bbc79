//! Reads what a command is given: scenes, models, and `ID=VALUE` pairs.

use super::error::Failure;
use super::output;
use crate::api::v1::{Formula, ModelChoice, model_choice};
use crate::scene::{Outlier, Scene, parse, parse_csv};
use crate::world::Preset;
use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Name of a scene's file in its folder.
pub const OBSERVED: &str = "observed.json";
/// What a formula is given as.
const FORMULA: &str = "give one such as \"ax = 0.1\", or a file that holds it (see `vrdp revise --help`)";
/// Strays that are named.
const STRAYS_NAMED: usize = 4;
/// Most bytes of a scene's file: all objects in all frames that are allowed take less.
const MAX_FILE: u64 = 1 << 30;

/// The scenes that the paths stand for: files, folders with an observed.json, folders of such folders or of CSV files.
/// A scene that cannot be read is for the caller to tell when the others are done.
pub fn scenes(paths: &[PathBuf]) -> Result<Vec<Result<Scene, Failure>>, Failure> {
    let mut files = Vec::new();
    for path in paths {
        if regular(path)? || path.join(OBSERVED).is_file() {
            files.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path).map_err(|e| unreadable(path, e))?;
        let one = |p: &PathBuf| p.join(OBSERVED).is_file() || (is_csv(p) && p.is_file());
        let mut folders: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(one).collect();
        if folders.is_empty() {
            let message =
                format!("{}: no {OBSERVED} here or one folder below, and no CSV file", path.display());
            return Err(Failure::input(message));
        }
        folders.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
        files.extend(folders);
    }
    let mut names = BTreeSet::new();
    let read = |path: &PathBuf| {
        let scene = scene(path)?;
        match names.insert(scene.name.clone()) {
            true => Ok(scene),
            false => Err(Failure::input("another scene has this name too; rename the file or folder of one")
                .at(&scene.name)),
        }
    };
    Ok(files.iter().map(read).collect())
}

/// Whether it is a file, and no folder; what is neither (a pipe may never end) is refused.
fn regular(path: &Path) -> Result<bool, Failure> {
    let found = path.metadata().map_err(|e| unreadable(path, e))?;
    if found.is_file() && found.len() > MAX_FILE {
        return Err(unreadable(path, format!("has {} bytes; at most {MAX_FILE} are read", found.len())));
    }
    if !found.is_file() && !found.is_dir() {
        return Err(unreadable(path, "is neither a file nor a folder"));
    }
    Ok(found.is_file())
}

fn unreadable(path: &Path, why: impl std::fmt::Display) -> Failure {
    Failure::input(format!("{}: {why}; give a scene file or folder", path.display()))
}

/// One scene: a file, or a folder with an observed.json; named after the folder, or the file's stem.
pub fn scene(path: &Path) -> Result<Scene, Failure> {
    let (file, name) = match path.is_dir() {
        true => (path.join(OBSERVED), path.canonicalize().ok().and_then(|p| last(p.file_name()))),
        false if path.file_name().is_some_and(|f| f == OBSERVED) => {
            let whole = path.canonicalize().unwrap_or(path.to_path_buf());
            (path.to_path_buf(), whole.parent().and_then(|p| last(p.file_name())))
        }
        false => (path.to_path_buf(), last(path.file_stem())),
    };
    let place = file.display().to_string();
    regular(&file)?;
    let text = std::fs::read_to_string(&file).map_err(|e| unreadable(&file, e))?;
    let name = name.unwrap_or("scene".into());
    let braces = text.trim_start_matches('\u{feff}').trim_start().starts_with('{');
    let rows = is_csv(&file) || !(braces || has(&file, "json"));
    let read = if rows { parse_csv(&name, &text) } else { parse(&name, &text) };
    let scene = read.map_err(|e| Failure::input(e.to_string()).at(&place))?;
    set_aside(&scene).iter().for_each(|line| output::tell(&format!("{}: {line}", scene.name)));
    Ok(scene)
}

/// What was set aside of a scene, for people.
pub fn set_aside(scene: &Scene) -> Option<String> {
    let one = |outlier: &Outlier| {
        let id = scene.objects.get(outlier.object).map_or(0, |o| o.id);
        format!("object {id} in frame {} ({:.3} m off)", outlier.sample.frame, outlier.distance)
    };
    let named: Vec<String> = scene.outliers.iter().take(STRAYS_NAMED).map(one).collect();
    let more = scene.outliers.len() - named.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let named = named.join(", ");
    (!named.is_empty()).then(|| format!("the tracker went astray, which is set aside: {named}{more}"))
}

fn is_csv(path: &Path) -> bool {
    has(path, "csv")
}

fn has(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// The text of a file, and of no folder or pipe.
pub fn text(path: &Path) -> Result<String, Failure> {
    match regular(path)? {
        true => std::fs::read_to_string(path).map_err(|e| unreadable(path, e)),
        false => Err(unreadable(path, "is a folder")),
    }
}

fn last(name: Option<&std::ffi::OsStr>) -> Option<String> {
    name.map(|name| name.to_string_lossy().into_owned())
}

/// Orders `scene_2` before `scene_10`.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let digits = |s: &str| s.bytes().take_while(u8::is_ascii_digit).count();
        let (m, n) = (digits(a), digits(b));
        if m > 0 && n > 0 {
            let (x, y) = (a[..m].trim_start_matches('0'), b[..n].trim_start_matches('0'));
            let order = x.len().cmp(&y.len()).then(x.cmp(y)).then(m.cmp(&n));
            if order != Ordering::Equal {
                return order;
            }
            (a, b) = (&a[m..], &b[n..]);
            continue;
        }
        let (mut x, mut y) = (a.chars(), b.chars());
        match (x.next(), y.next()) {
            (Some(p), Some(q)) if p == q => (a, b) = (x.as_str(), y.as_str()),
            (p, q) => return p.cmp(&q),
        }
    }
}

/// A law: a text that has a `=`, or the file that holds it; named after the file where no name is given.
pub fn formula(given: &str, name: Option<&str>) -> Result<Formula, Failure> {
    let path = Path::new(given);
    let (text, stem) = if given.contains('=') {
        (given.to_string(), None)
    } else if given.trim().is_empty() {
        (String::new(), None)
    } else {
        let read = match path.metadata() {
            Ok(found) if !found.is_file() => Err(std::io::Error::other("it is no file")),
            Ok(found) if found.len() > MAX_FILE => Err(std::io::Error::other("it is too large")),
            _ => std::fs::read_to_string(path),
        };
        let text = read.map_err(|e| Failure::input(format!("{given}: {e}; {FORMULA}")))?;
        (text, last(path.file_stem()))
    };
    if text.trim().is_empty() {
        return Err(Failure::input(format!("the formula is empty; {FORMULA}")));
    }
    let name = name.map(str::to_string).or(stem).unwrap_or_default();
    Ok(Formula { name, text, parameters: vec![] })
}

/// A model to begin with: the name of a preset, a model that the service keeps, or a model file.
pub fn model(choice: Option<&str>) -> Result<Option<ModelChoice>, Failure> {
    let Some(choice) = choice else { return Ok(None) };
    let kind = if Preset::named(choice).is_some() {
        model_choice::Choice::Preset(choice.into())
    } else if choice.starts_with("videos/") {
        model_choice::Choice::Model(choice.into())
    } else {
        let read = match Path::new(choice).metadata() {
            Ok(found) if !found.is_file() => Err(std::io::Error::other("it is no file")),
            _ => std::fs::read_to_string(choice),
        };
        let none = |e: &dyn std::fmt::Display| {
            let known: Vec<&str> = crate::world::PRESETS.iter().map(|p| p.name).collect();
            let known = known.join(", ");
            Failure::input(format!("model {choice}: neither a preset ({known}) nor a model file ({e})"))
        };
        let text = read.map_err(|e| none(&e))?;
        serde_json::from_str::<serde::de::IgnoredAny>(&text).map_err(|e| none(&e))?;
        model_choice::Choice::ModelJson(text)
    };
    Ok(Some(ModelChoice { choice: Some(kind) }))
}

/// `ID=VALUE`, for clap.
pub fn id_and_number(text: &str) -> Result<(u32, f64), String> {
    let (id, value) = text.split_once('=').ok_or("write ID=FACTOR, such as 3=5")?;
    Ok((id.parse().map_err(|e| format!("id {id}: {e}"))?, number(value)?))
}

/// `ID=VX,VY`, for clap.
pub fn id_and_vector(text: &str) -> Result<(u32, [f64; 2]), String> {
    let wrong = "write ID=VX,VY, such as 3=0.5,-1";
    let (id, value) = text.split_once('=').ok_or(wrong)?;
    let (x, y) = value.split_once(',').ok_or(wrong)?;
    Ok((id.parse().map_err(|e| format!("id {id}: {e}"))?, [number(x)?, number(y)?]))
}

fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|e| format!("{text}: {e}"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("{text} is not finite")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_in_natural_order() {
        let mut names = ["s10", "s2", "s02", "s", "t1"];
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(names, ["s", "s2", "s02", "s10", "t1"]);
    }

    #[test]
    fn one_bad_scene_leaves_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let good = include_str!("../../tests/data/clevrer/scene_00022/observed.json");
        for (name, text) in [("a", good), ("b", "{"), ("c", good)] {
            std::fs::create_dir(folder.path().join(name)).unwrap();
            std::fs::write(folder.path().join(name).join(OBSERVED), text).unwrap();
        }
        let read = scenes(&[folder.path().to_path_buf()]).unwrap();
        let names: Vec<Option<&str>> =
            read.iter().map(|r| r.as_ref().ok().map(|s| s.name.as_str())).collect();
        assert_eq!(names, [Some("a"), None, Some("c")]);
        assert!(
            scene(Path::new("/dev/null")).unwrap_err().to_string().contains("neither a file nor a folder")
        );
    }

    #[test]
    fn a_formula_that_is_none_says_what_to_give() {
        for wrong in ["", "  ", "no_such_file", "/dev/null"] {
            let said = formula(wrong, None).unwrap_err().to_string();
            assert!(said.contains("give one such as \"ax = 0.1\""), "{wrong}: {said}");
        }
        assert_eq!(formula("ax = 1", None).unwrap().text, "ax = 1");
    }

    #[test]
    fn pairs_are_read_or_explained() {
        assert_eq!(id_and_number("3=0.2"), Ok((3, 0.2)));
        assert_eq!(id_and_vector("3=0.5,-1"), Ok((3, [0.5, -1.0])));
        for wrong in ["3", "x=1", "3=", "3=nan", "-1=2"] {
            assert!(id_and_number(wrong).is_err(), "{wrong}");
        }
    }
}
