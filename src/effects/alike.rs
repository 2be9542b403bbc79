//! Effects that an unknown name may mean.

use super::EFFECTS;

/// Most names of an answer.
const MOST: usize = 3;
/// Most typing errors of a name.
const TYPING_ERRORS: usize = 2;

/// Names of effects that are like one that nobody knows: by spelling, by a word of the name, or by a word of what the
/// effect is, as wind is a uniform force. Without any, those that look most like it.
pub fn alike(name: &str) -> Vec<&'static str> {
    let name = name.to_lowercase();
    let words: Vec<&str> = name.split(['_', '-', ' ']).filter(|word| word.len() > 2).collect();
    let has_word = |text: &str, by: fn(char) -> bool| text.split(by).any(|word| words.contains(&word));
    let mut ranked: Vec<(f64, &'static str)> = EFFECTS
        .iter()
        .map(|e| {
            let known = e.spec.name;
            let by_spelling = strsim::osa_distance(known, &name) <= TYPING_ERRORS;
            let by_word = has_word(known, |c| c == '_') || words.contains(&e.kind);
            let by_meaning = has_word(&e.spec.doc.to_lowercase(), |c| !c.is_alphabetic());
            let points: u8 = [(by_spelling, 4), (by_word, 2), (by_meaning, 1)]
                .into_iter()
                .filter_map(|(fits, points)| fits.then_some(points))
                .sum();
            (f64::from(points) + 0.99 * strsim::jaro_winkler(known, &name), known)
        })
        .collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let meant = ranked.iter().filter(|(points, _)| *points >= 1.0).count();
    let shown = if meant > 0 { meant.min(MOST) } else { MOST };
    ranked.iter().take(shown).map(|(_, known)| *known).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_name_means_what_is_spelt_or_described_like_it() {
        for (given, meant) in [
            ("wind", "uniform_force"),
            ("coriolys", "coriolis"),
            ("air_drag", "quadratic_drag"),
            ("Quadratic-drag", "quadratic_drag"),
        ] {
            assert!(alike(given).contains(&meant), "{given}: {:?}", alike(given));
        }
        assert_eq!(alike("wind").len(), 1);
        assert_eq!(alike("xyzzy").len(), MOST);
    }
}
