//! The known name that a misspelt one means.

/// The known name nearest to this one, if it differs by one or two typing errors.
pub fn misspelt<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let sorted = |word: &str| {
        let mut letters: Vec<char> = word.chars().collect();
        letters.sort_unstable();
        letters
    };
    let allowed = |near: &str| match near.len() {
        // Of a short name only one letter too many or two exchanged, as "row" does not mean "yaw".
        3 => usize::from(name.len() > 3 || sorted(name) == sorted(near)),
        short @ ..6 => short / 4,
        _ => 2,
    };
    let distance = |known: &&str| strsim::osa_distance(known, name);
    known.min_by_key(distance).filter(|near| distance(near) <= allowed(near))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typing_errors_are_recognised_and_other_words_are_not() {
        let meant = |name| misspelt(name, ["fps", "scale", "yaw", "unit"].into_iter());
        assert_eq!(meant("fsp"), Some("fps"));
        assert_eq!(meant("scael"), Some("scale"));
        assert_eq!(meant("yaww"), Some("yaw"));
        assert_eq!([meant("row"), meant("ftp"), meant("note")], [None, None, None]);
    }
}
