//! What the scenes of a command do not state: every result says what was assumed instead.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The scenes of this process, and each assumption with the scenes that it is made for.
#[derive(Default)]
struct Assumed {
    scenes: Vec<String>,
    lines: BTreeMap<(usize, String), Vec<String>>,
}

static ASSUMED: Mutex<Option<Assumed>> = Mutex::new(None);

/// No code panics while it holds this lock.
fn assumed() -> MutexGuard<'static, Option<Assumed>> {
    ASSUMED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Takes a scene that was read, with its assumptions.
pub fn add(scene: &str, lines: Vec<String>) {
    let mut assumed = assumed();
    let all = assumed.get_or_insert_with(Assumed::default);
    all.scenes.push(scene.to_string());
    for (place, line) in lines.into_iter().enumerate() {
        all.lines.entry((place, line)).or_default().push(scene.to_string());
    }
}

/// The assumptions; each names its scenes unless it holds for all.
pub fn lines() -> Vec<String> {
    assumed().as_ref().map_or_else(Vec::new, Assumed::shown)
}

impl Assumed {
    fn shown(&self) -> Vec<String> {
        let shown =
            |((_, line), scenes): (&(usize, String), &Vec<String>)| match scenes.len() == self.scenes.len() {
                true => line.clone(),
                false => format!("{}: {line}", scenes.join(", ")),
            };
        self.lines.iter().map(shown).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_assumption_names_its_scenes_unless_it_holds_for_all() {
        let both = vec!["a".to_string(), "b".to_string()];
        let mut all = Assumed { scenes: both.clone(), ..Assumed::default() };
        all.lines.insert((0, "25 frames per second".into()), both);
        all.lines.insert((1, "masses near 1 kg".into()), vec!["b".into()]);
        assert_eq!(all.shown(), ["25 frames per second", "b: masses near 1 kg"]);
    }
}
