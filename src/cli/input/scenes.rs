//! Reads the scenes that a command is given.

use super::files::{is_regular_file, last, unreadable};
use super::videos::{VIDEO, VideoView, is_named_video, is_video_file, see};
use crate::cli::error::Failure;
use crate::cli::output;
use crate::scene::{Outlier, Scene, SceneFile, TableDefaults, holds_positions, read_scene};
use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Name of a scene's file in its folder.
pub const OBSERVED: &str = "observed.json";
/// How the names of CLEVRER's annotations, and of their folders, begin.
const ANNOTATION: &str = "annotation_";
/// Extensions of tables and projects of trackers, and of texts that may be tables.
const TABLES: [&str; 10] = ["csv", "tsv", "tab", "trk", "trz", "jsonl", "mdf", "trc", "xlsx", "npz"];
const TEXTS: [&str; 3] = ["txt", "dat", "log"];
/// Extensions of files that hold tracks, but no text.
const BINARIES: [&str; 6] = ["h5", "hdf5", "parquet", "slp", "xls", "npy"];
/// Bytes at the start of a text file that show whether it is a table.
const TABLE_START: u64 = 1 << 16;
/// Number of outliers that a message lists.
const OUTLIERS_NAMED: usize = 4;

/// Reads the scenes of the paths. A scene that cannot be read is an error of its own: the caller reports it after the others
/// are done.
pub fn scenes(paths: &[PathBuf]) -> Result<Vec<Result<Scene, Failure>>, Failure> {
    let mut files = Vec::new();
    for path in paths {
        files.extend(scene_paths(path)?);
    }
    let mut names = BTreeSet::new();
    let read =
        |path: &PathBuf| {
            let scene = scene(path)?;
            match names.insert(scene.name.clone()) {
                true => Ok(scene),
                false => Err(Failure::input("two scenes have this name; rename the file or folder of one")
                    .at(&scene.name)),
            }
        };
    Ok(files.iter().map(read).collect())
}

/// The scenes of a path, in natural order: a file, a folder with an observed.json, a folder of such folders, of tables or of
/// CLEVRER's annotations, or a folder of folders of these annotations.
pub fn scene_paths(path: &Path) -> Result<Vec<PathBuf>, Failure> {
    let holds = |folder: &Path| folder.join(OBSERVED).is_file() || folder.join(VIDEO).is_file();
    if is_regular_file(path)? || holds(path) {
        return Ok(vec![path.to_path_buf()]);
    }
    let within = |folder: &Path| -> Result<Vec<PathBuf>, Failure> {
        let entries = std::fs::read_dir(folder).map_err(|e| unreadable(folder, e))?;
        let mut all: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
        all.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
        Ok(all)
    };
    let is_scene =
        |p: &PathBuf| holds(p) || is_named_video(p) || (p.is_file() && (is_table(p) || is_annotation(p)));
    let all = within(path)?;
    let mut found: Vec<PathBuf> = all.iter().filter(|p| is_scene(p)).cloned().collect();
    if found.is_empty() {
        // CLEVRER's release: annotation_train/annotation_00000-01000/annotation_00000.json.
        for folder in all.iter().filter(|p| p.is_dir() && is_named_annotation(p)) {
            found.extend(within(folder)?.into_iter().filter(|p| p.is_file() && is_annotation(p)));
        }
    }
    if found.is_empty() {
        // Their errors say how to write them as text.
        found = all.iter().filter(|p| p.is_file() && BINARIES.iter().any(|b| has(p, b))).cloned().collect();
    }
    if found.is_empty() {
        return Err(Failure::input(format!(
            "{}: neither this folder nor its subfolders hold an {OBSERVED}, a table (CSV or text), a video or a CLEVRER annotation \
             (annotation_*.json); give a scene file or folder",
            path.display()
        )));
    }
    Ok(found)
}

/// Whether it is named as CLEVRER's annotations are.
fn is_annotation(path: &Path) -> bool {
    has(path, "json") && is_named_annotation(path)
}

fn is_named_annotation(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(ANNOTATION))
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
    if let Some(first) =
        path.is_dir().then(|| scene_paths(path)).transpose()?.and_then(|all| all.into_iter().next())
        && first != path
    {
        let message = format!(
            "{}: is a folder of scenes; give one of them, such as {}",
            path.display(),
            first.display()
        );
        return Err(Failure::input(message));
    }
    if let Some(video) = video_of(path, &file) {
        let seen = see(&video, &VideoView::default())?;
        output::tell(&format!("{}: {}", seen.scene.name, seen.line()));
        return Ok(accepted(seen.scene, vec![]));
    }
    is_regular_file(&file)?;
    let bytes = std::fs::read(&file).map_err(|e| unreadable(&file, e))?;
    let name = name.unwrap_or("scene".into());
    let read = read_scene(&name, &bytes, &TableDefaults::default());
    let SceneFile { scene, assumed, .. } = read.map_err(|e| Failure::input(e.to_string()).at(&place))?;
    Ok(accepted(scene, assumed))
}

/// The video of a folder without tracks, or the file if it is one.
fn video_of(path: &Path, file: &Path) -> Option<PathBuf> {
    let inside = path.join(VIDEO);
    match path.is_dir() && !file.is_file() && inside.is_file() {
        true => Some(inside),
        false => is_video_file(file).then(|| file.to_path_buf()),
    }
}

/// Reports what was assumed of a scene, and what its tracks show.
fn accepted(scene: Scene, assumed: Vec<String>) -> Scene {
    output::assumptions::add(&scene, assumed);
    outlier_message(&scene).iter().for_each(|line| output::tell(&format!("{}: {line}", scene.name)));
    scene
}

/// A message that lists the tracking outliers of a scene, if there are any.
pub fn outlier_message(scene: &Scene) -> Option<String> {
    let one = |outlier: &Outlier| {
        let id = scene.objects.get(outlier.object).map_or(0, |o| o.id);
        format!("object {id} in frame {} ({:.3} m off)", outlier.sample.frame, outlier.distance)
    };
    // What repeats the position before is no distance off; findings tell of it.
    let off: Vec<&Outlier> = scene.outliers.iter().filter(|o| o.distance > 0.0).collect();
    let named: Vec<String> = off.iter().take(OUTLIERS_NAMED).map(|o| one(o)).collect();
    let more = off.len() - named.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let named = named.join(", ");
    (!named.is_empty()).then(|| format!("tracking outliers are ignored: {named}{more}"))
}

/// Whether it is a table of positions, by its name; a text file may be something else, so its start decides.
fn is_table(path: &Path) -> bool {
    let any = |extensions: &[&str]| extensions.iter().any(|extension| has(path, extension));
    any(&TABLES) || (any(&TEXTS) && starts_as_table(path))
}

fn starts_as_table(path: &Path) -> bool {
    let mut start = vec![];
    let read = std::fs::File::open(path).and_then(|file| file.take(TABLE_START).read_to_end(&mut start));
    read.is_ok() && holds_positions(&start)
}

fn has(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// Natural order: `scene_2` before `scene_10`.
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
        let good = include_str!("../../../tests/data/clevrer/scene_00022/observed.json");
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
}
