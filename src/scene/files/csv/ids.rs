//! Objects by the names that a table gives them, and their numbers.

use std::collections::{BTreeMap, BTreeSet};

/// Most names that a message lists.
const LISTED: usize = 12;

/// The names of the objects of a table, in the order in which they were met.
#[derive(Default)]
pub(super) struct ObjectNames {
    names: Vec<String>,
    places: BTreeMap<String, usize>,
}

/// The number that a name is.
fn whole(name: &str) -> Option<u32> {
    let value =
        name.parse::<f64>().ok().filter(|v| (0.0..=f64::from(u32::MAX)).contains(v) && v.fract() == 0.0)?;
    Some(value as u32)
}

/// A name up to its last digits, and these.
fn stem_and_number(name: &str) -> Option<(&str, u32)> {
    let digits = name.bytes().rev().take_while(u8::is_ascii_digit).count();
    let (stem, number) = name.split_at_checked(name.len() - digits)?;
    Some((stem, number.parse().ok()?))
}

impl ObjectNames {
    /// The place of a name; `1`, `01` and `1.0` are one name.
    pub fn place(&mut self, name: &str) -> usize {
        let name = whole(name).map_or_else(|| name.trim().to_string(), |number| number.to_string());
        let next = self.names.len();
        *self.places.entry(name).or_insert_with_key(|name| {
            self.names.push(name.clone());
            next
        })
    }

    pub fn name(&self, place: usize) -> &str {
        self.names.get(place).map_or("", String::as_str)
    }

    /// The number of each object. Numbers stay; names such as `puck2` get theirs; others are numbered by name, so that the
    /// order of rows and columns has no effect.
    pub fn numbers(&self) -> Vec<u32> {
        let words: Vec<&String> = self.names.iter().filter(|name| whole(name).is_none()).collect();
        let mut taken: BTreeSet<u32> = self.names.iter().filter_map(|name| whole(name)).collect();
        let ends: Option<Vec<(&str, u32)>> = words.iter().map(|name| stem_and_number(name)).collect();
        let ends = ends.filter(|ends| {
            let distinct: BTreeSet<u32> = ends.iter().map(|(_, number)| *number).collect();
            ends.windows(2).all(|pair| pair[0].0 == pair[1].0)
                && distinct.len() == ends.len()
                && distinct.is_disjoint(&taken)
        });
        let mut sorted = words.clone();
        sorted.sort();
        let mut numbers: BTreeMap<&str, u32> = BTreeMap::new();
        for (at, name) in sorted.into_iter().enumerate() {
            let own = ends.as_ref().and_then(|_| stem_and_number(name)).map(|(_, number)| number);
            let free = || (at as u32..).find(|number| !taken.contains(number)).unwrap_or(u32::MAX);
            let number = own.unwrap_or_else(free);
            taken.insert(number);
            numbers.insert(name, number);
        }
        let number = |name: &String| whole(name).or_else(|| numbers.get(name.as_str()).copied()).unwrap_or(0);
        self.names.iter().map(number).collect()
    }

    /// Which number stands for which name; `None` where the names are numbers.
    pub fn in_words(&self) -> Option<String> {
        let mut all: Vec<(u32, &String)> = self.numbers().into_iter().zip(&self.names).collect();
        all.retain(|(_, name)| whole(name).is_none());
        all.sort();
        let listed: Vec<String> =
            all.iter().take(LISTED).map(|(number, name)| format!("{number} is {name}")).collect();
        let more = if all.len() > LISTED { ", ..." } else { "" };
        (!all.is_empty()).then(|| format!("numbers for the names of objects: {}{more}", listed.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_get_numbers_that_no_order_changes() {
        let numbers = |names: &[&str]| {
            let mut all = ObjectNames::default();
            for name in names {
                all.place(name);
            }
            all.numbers()
        };
        assert_eq!(numbers(&["B", "A"]), [1, 0]);
        assert_eq!(numbers(&["puck2", "puck1"]), [2, 1]);
        assert_eq!(numbers(&["7", "07", "7.0", "2"]), [7, 2]);
        assert_eq!(numbers(&["ball", "0", "cup"]), [1, 0, 2]);
        assert_eq!(numbers(&["a1", "b1"]), [0, 1]);
        let mut all = ObjectNames::default();
        all.place("red");
        assert_eq!(all.in_words().as_deref(), Some("numbers for the names of objects: 0 is red"));
    }
}
