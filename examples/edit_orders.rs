//! Measures whether a model's fit depends on the order of the edits that led to it:
//!
//! `cargo run --release --example edit_orders -- DIR...`, each a group of scene folders or a folder of groups.
//!
//! Each group gets each set of three edits in all six orders. It prints for each set the largest distance between the shared
//! numbers of two orders, in standard deviations, and the least and largest reduced chi-square; at the end, the number of sets
//! in which all orders agree to 0.1 standard deviations, of those whose best fit follows the videos: the optimum of a model that
//! does not is a matter of chaos.

use std::error::Error;
use std::path::{Path, PathBuf};
use vrdp::discover::{DiscoverOptions, ModelChange, Origin, Revision, change};
use vrdp::fit::SceneFit;
use vrdp::num::never;
use vrdp::scene::{Scene, parse};
use vrdp::world::{Model, Preset};

/// Orders agree that differ by less (standard deviations).
const SAME: f64 = 0.1;
/// A fit follows its videos up to this reduced chi-square.
const FOLLOWED: f64 = 1.5;
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

fn add(name: &str) -> ModelChange {
    ModelChange::Add(name.into())
}

fn remove(name: &str) -> ModelChange {
    ModelChange::Remove(name.into())
}

fn edits() -> [[ModelChange; 3]; 2] {
    [
        [add("uniform_force"), add("linear_drag"), remove("friction_offset")],
        [add("tilt"), add("coriolis"), add("quadratic_drag")],
    ]
}

fn main() -> Result<(), Box<dyn Error>> {
    let (mut same, mut sets) = (0, 0);
    for folder in std::env::args().skip(1).map(PathBuf::from) {
        for group in groups_in(&folder)? {
            let scenes = scenes_in(&group)?;
            for edits in edits() {
                let names: Vec<String> = edits.iter().map(word).collect();
                let revisions: Result<Vec<Revision>, _> =
                    ORDERS.iter().map(|order| edited(&scenes, order.map(|k| &edits[k]))).collect();
                let (apart, chi) = compared(&revisions?);
                let group = group.file_name().unwrap_or_default().to_string_lossy();
                println!(
                    "{group:36} {:56} {apart:8.3} sd, reduced chi-square {:.4} to {:.4}",
                    names.join(" "),
                    chi[0],
                    chi[1]
                );
                let followed = chi[0] < FOLLOWED;
                same += usize::from(followed && apart < SAME);
                sets += usize::from(followed);
            }
        }
    }
    println!("the same to {SAME} sd: {same} of {sets}");
    Ok(())
}

fn word(edit: &ModelChange) -> String {
    match edit {
        ModelChange::Add(name) | ModelChange::Write(name, _) => format!("+{name}"),
        ModelChange::Remove(name) => format!("-{name}"),
    }
}

/// The last revision after the edits in this order.
fn edited(scenes: &[Scene], edits: [&ModelChange; 3]) -> Result<Revision, Box<dyn Error>> {
    let base: Vec<Model> = scenes.iter().map(|s| Preset::for_world(s.world).model(s)).collect();
    let mut last: Option<Revision> = None;
    for edit in edits {
        let fits: Vec<&SceneFit> = last.iter().flat_map(|r| &r.fit.scenes).collect();
        let origin = match &last {
            Some(r) => Origin::Revision(&fits, r.unseen()),
            None => Origin::Start(&base),
        };
        last = Some(change(scenes, &origin, edit, &DiscoverOptions::default().fit, &never)?.after);
    }
    last.ok_or_else(|| "there is no edit".into())
}

/// The largest distance between two revisions' shared numbers (standard deviations), and the range of chi-square.
fn compared(revisions: &[Revision]) -> (f64, [f64; 2]) {
    let chi = |r: &Revision| r.reduced_chi_square;
    let least = revisions.iter().map(chi).fold(f64::INFINITY, f64::min);
    let most = revisions.iter().map(chi).fold(0.0, f64::max);
    let best = revisions.iter().min_by(|a, b| chi(a).total_cmp(&chi(b)));
    let mut apart = 0.0;
    for e in best.iter().flat_map(|r| &r.fit.posterior.estimates).filter(|e| e.scene.is_none() && e.sd > 0.0)
    {
        for other in revisions.iter().flat_map(|r| &r.fit.posterior.estimates).filter(|o| o.name == e.name) {
            if other.scene.is_none() {
                apart = f64::max(apart, (other.value - e.value).abs() / e.sd);
            }
        }
    }
    (apart, [least, most])
}

fn scenes_in(group: &Path) -> Result<Vec<Scene>, Box<dyn Error>> {
    let folders = inner(group)?.into_iter().filter(|f| is_scene(f));
    folders
        .map(|folder| {
            let text = std::fs::read_to_string(folder.join("observed.json"))?;
            Ok(parse(&folder.display().to_string(), &text)?)
        })
        .collect()
}

fn is_scene(folder: &Path) -> bool {
    folder.join("observed.json").is_file()
}

fn inner(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut inner: Vec<PathBuf> = std::fs::read_dir(folder)?.flatten().map(|e| e.path()).collect();
    inner.sort();
    Ok(inner)
}

/// Folders of scenes: this folder, or the folders in it.
fn groups_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let holds = |f: &Path| f.is_dir() && inner(f).is_ok_and(|inner| inner.iter().any(|s| is_scene(s)));
    match holds(folder) {
        true => Ok(vec![folder.to_path_buf()]),
        false => Ok(inner(folder)?.into_iter().filter(|f| holds(f)).collect()),
    }
}
