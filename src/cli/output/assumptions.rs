//! What the scenes of a command do not state, and what their tracks show: every result says both.

use crate::scene::Scene;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The scenes of this process, and each line with the scenes that it is about.
#[derive(Default)]
struct SceneLines {
    scenes: Vec<String>,
    assumed: BTreeMap<(usize, String), Vec<String>>,
    found: BTreeMap<(usize, String), Vec<String>>,
}

static LINES: Mutex<Option<SceneLines>> = Mutex::new(None);

/// No code panics while it holds this lock.
fn scene_lines() -> MutexGuard<'static, Option<SceneLines>> {
    LINES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Takes a scene that was read, with what was assumed of it.
pub fn add(scene: &Scene, assumed: Vec<String>) {
    let found = scene.findings.iter().map(ToString::to_string).collect();
    let mut lines = scene_lines();
    let all = lines.get_or_insert_with(SceneLines::default);
    all.scenes.push(scene.name.clone());
    for (of, new) in [(&mut all.assumed, assumed), (&mut all.found, found)] {
        for (place, line) in new.into_iter().enumerate() {
            of.entry((place, line)).or_default().push(scene.name.clone());
        }
    }
}

/// What was assumed, and what tracks show; each line names its scenes unless it holds for all.
pub fn lines() -> [Vec<String>; 2] {
    let lines = scene_lines();
    lines.as_ref().map_or_else(Default::default, |all| [&all.assumed, &all.found].map(|of| all.shown(of)))
}

impl SceneLines {
    fn shown(&self, of: &BTreeMap<(usize, String), Vec<String>>) -> Vec<String> {
        let shown =
            |((_, line), scenes): (&(usize, String), &Vec<String>)| match scenes.len() == self.scenes.len() {
                true => line.clone(),
                false => format!("{}: {line}", scenes.join(", ")),
            };
        of.iter().map(shown).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_assumption_names_its_scenes_unless_it_holds_for_all() {
        let both = vec!["a".to_string(), "b".to_string()];
        let mut all = SceneLines { scenes: both.clone(), ..SceneLines::default() };
        all.assumed.insert((0, "25 frames per second".into()), both);
        all.assumed.insert((1, "masses near 1 kg".into()), vec!["b".into()]);
        assert_eq!(all.shown(&all.assumed), ["25 frames per second", "b: masses near 1 kg"]);
    }
}
