//! The command to try next, under each result.

use super::progress::is_quiet;
use std::path::PathBuf;

/// The line under a result that names the command to try next: `command`, the scenes, then the other words.
pub fn next(command: &str, scenes: &[PathBuf], words: &[&str]) -> String {
    if is_quiet() {
        return String::new();
    }
    let scenes = scenes.iter().map(|scene| quoted(&scene.display().to_string()));
    let words = scenes.chain(words.iter().map(|word| quoted(word)));
    format!("\nnext: vrdp {command} {}\n", words.collect::<Vec<_>>().join(" "))
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,@+".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_string();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_command_can_be_pasted() {
        let line = next("fit", &["a b.csv".into()], &["--data-dir", "it's"]);
        assert_eq!(line, "\nnext: vrdp fit 'a b.csv' --data-dir 'it'\\''s'\n");
    }
}
