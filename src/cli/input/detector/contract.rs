//! The JSON beside a model: what its outputs are. Everything that is wrong is reported at once.

use super::error::DetectorError;
use crate::scene::misspelt;
use serde_json::{Map, Value};

/// Least score of a detection where the file states none.
const LEAST_SCORE: f64 = 0.5;
/// Largest width and height of a network's input (px).
const MAX_SIDE: u64 = 8192;
const KEYS: [&str; 8] =
    ["output", "names", "labels", "least_score", "coordinates", "size", "mask_values", "least_pixels"];
const NAMES: [&str; 5] = ["boxes", "scores", "labels", "masks", "features"];
const WORDS: [&str; 3] = ["shape", "color", "material"];

/// What the outputs of a network are.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DetectorContract {
    pub regions: RegionOutput,
    /// Names of the outputs with a score of each detection, the index of its label, and its features.
    pub scores: Option<String>,
    pub classes: Option<String>,
    pub features: Option<String>,
    pub labels: Vec<Look>,
    pub least_score: f64,
    /// Width and height to which frames are brought (px).
    pub size: Option<[usize; 2]>,
}

/// The output that says where bodies are, by its name.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum RegionOutput {
    /// Left, top, right and bottom of each body; `relative`: from 0 to 1, else in pixels of the input.
    Boxes { name: String, relative: bool },
    /// A plane for each detection, or without scores for each label. `logits`: a body is where they are above 0, else where they
    /// are above 0.5.
    Masks { name: String, logits: bool, least_pixels: usize },
}

/// The words of a label.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Look {
    pub shape: Option<String>,
    pub color: Option<String>,
    pub material: Option<String>,
}

impl RegionOutput {
    pub(super) fn name(&self) -> &str {
        match self {
            RegionOutput::Boxes { name, .. } | RegionOutput::Masks { name, .. } => name,
        }
    }
}

impl DetectorContract {
    pub(super) fn parse(text: &str) -> Result<DetectorContract, DetectorError> {
        let mut reader = ContractReader::default();
        let root = match serde_json::from_str(text.trim_start_matches('\u{feff}')) {
            Ok(Value::Object(root)) => root,
            Ok(_) => return Err(DetectorError::field("(file)", "is no JSON object; give one")),
            Err(error) => return Err(DetectorError::field("(file)", format!("is not JSON: {error}"))),
        };
        let contract = reader.contract(&root);
        match (contract, reader.wrong.is_empty()) {
            (Some(contract), true) => Ok(contract),
            _ => Err(DetectorError::Fields(reader.wrong)),
        }
    }

    /// Names of all outputs that are read.
    pub(super) fn outputs(&self) -> Vec<&str> {
        let others = [&self.scores, &self.classes, &self.features];
        std::iter::once(self.regions.name()).chain(others.into_iter().flatten().map(String::as_str)).collect()
    }
}

/// Reads fields, and collects those that are wrong with their messages.
#[derive(Default)]
struct ContractReader {
    wrong: Vec<(String, String)>,
}

impl ContractReader {
    fn add(&mut self, field: impl Into<String>, message: impl Into<String>) {
        self.wrong.push((field.into(), message.into()));
    }

    fn contract(&mut self, root: &Map<String, Value>) -> Option<DetectorContract> {
        self.unknown("", root, &KEYS);
        let empty = Map::new();
        let names = match root.get("names") {
            Some(Value::Object(names)) => names,
            None | Some(Value::Null) => &empty,
            Some(other) => {
                self.add("names", format!("is {other}; give an object with the names of outputs"));
                &empty
            }
        };
        self.unknown("names.", names, &NAMES);
        let [boxes, scores, classes, masks, features] = NAMES.map(|key| self.text("names.", names, key));
        let output = self.one_of(root, "output", &["boxes", "masks"], None);
        let coordinates = self.one_of(root, "coordinates", &["pixels", "relative"], Some(0));
        let values = self.one_of(root, "mask_values", &["logits", "probabilities"], Some(0));
        let least_pixels = self.count(root, "least_pixels").unwrap_or(1);
        let labels = self.labels(root);
        let least_score = self.least_score(root);
        let size = self.size(root);
        let missing = "is missing; give the name of that output of the model";
        let regions = match output? {
            0 => boxes.map(|name| RegionOutput::Boxes { name, relative: coordinates == Some(1) }),
            _ => masks.map(|name| RegionOutput::Masks { name, logits: values == Some(0), least_pixels }),
        };
        if regions.is_none() {
            self.add(if output == Some(0) { "names.boxes" } else { "names.masks" }, missing);
        }
        if scores.is_none() && output == Some(0) {
            self.add("names.scores", missing);
        }
        if scores.is_none() && output == Some(1) && classes.is_some() {
            self.add(
                "names.labels",
                "is given without names.scores, where each mask is of one label; leave it out",
            );
        }
        if classes.is_some() && labels.is_empty() {
            self.add(
                "labels",
                "is missing or empty, but names.labels is given; list the words of each label",
            );
        }
        Some(DetectorContract { regions: regions?, scores, classes, features, labels, least_score, size })
    }

    fn unknown(&mut self, at: &str, object: &Map<String, Value>, known: &[&str]) {
        for key in object.keys().filter(|key| !known.contains(&key.as_str())) {
            let message = match misspelt(key, known.iter().copied()) {
                Some(meant) => format!("is unknown; did you mean {meant}?"),
                None => format!("is unknown; known are {}", known.join(", ")),
            };
            self.add(format!("{at}{key}"), message);
        }
    }

    fn text(&mut self, at: &str, from: &Map<String, Value>, key: &str) -> Option<String> {
        match from.get(key)? {
            Value::Null => None,
            Value::String(text) if !text.is_empty() => Some(text.clone()),
            other => {
                self.add(format!("{at}{key}"), format!("is {other}; give a text, or leave it out"));
                None
            }
        }
    }

    /// The index of a field's word among those that it may have; `default`: where it is missing.
    fn one_of(
        &mut self,
        root: &Map<String, Value>,
        key: &str,
        words: &[&str],
        default: Option<usize>,
    ) -> Option<usize> {
        let found = root.get(key).filter(|v| !v.is_null());
        let known = match found {
            None => default,
            Some(value) => value.as_str().and_then(|text| words.iter().position(|word| *word == text)),
        };
        if known.is_none() {
            let is = found.map_or("missing".to_string(), Value::to_string);
            self.add(key, format!("is {is}; give \"{}\"", words.join("\" or \"")));
        }
        known
    }

    fn count(&mut self, root: &Map<String, Value>, key: &str) -> Option<usize> {
        let value = root.get(key).filter(|v| !v.is_null())?;
        let count = value.as_u64().filter(|n| *n > 0).and_then(|n| usize::try_from(n).ok());
        if count.is_none() {
            self.add(key, format!("is {value}; give a whole number from 1"));
        }
        count
    }

    fn least_score(&mut self, root: &Map<String, Value>) -> f64 {
        let Some(value) = root.get("least_score").filter(|v| !v.is_null()) else { return LEAST_SCORE };
        let score = value.as_f64().filter(|s| *s > 0.0 && *s <= 1.0);
        if score.is_none() {
            self.add("least_score", format!("is {value}; give a number above 0 and up to 1"));
        }
        score.unwrap_or(LEAST_SCORE)
    }

    fn size(&mut self, root: &Map<String, Value>) -> Option<[usize; 2]> {
        let value = root.get("size").filter(|v| !v.is_null())?;
        let side = |k: usize| value.get(k)?.as_u64().filter(|s| (1..=MAX_SIDE).contains(s));
        let size = match (side(0), side(1), value.as_array().map(Vec::len)) {
            (Some(width), Some(height), Some(2)) => Some([width as usize, height as usize]),
            _ => None,
        };
        if size.is_none() {
            self.add(
                "size",
                format!("is {value}; give [width, height] of the input, each up to {MAX_SIDE} px"),
            );
        }
        size
    }

    fn labels(&mut self, root: &Map<String, Value>) -> Vec<Look> {
        let list = match root.get("labels") {
            Some(Value::Array(list)) => list.as_slice(),
            None | Some(Value::Null) => &[],
            Some(other) => {
                self.add("labels", format!("is {other}; give a list with the words of each label"));
                &[]
            }
        };
        let mut labels = vec![];
        for (k, label) in list.iter().enumerate() {
            let Some(words) = label.as_object() else {
                self.add(
                    format!("labels[{k}]"),
                    format!("is {label}; give an object with {}", WORDS.join(", ")),
                );
                continue;
            };
            let at = format!("labels[{k}].");
            self.unknown(&at, words, &WORDS);
            let [shape, color, material] =
                WORDS.map(|key| self.text(&at, words, key).map(|word| word.to_lowercase()));
            labels.push(Look { shape, color, material });
        }
        labels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOXES: &str = r#"{"output": "boxes", "names": {"boxes": "b", "scores": "s", "labels": "l", "features": "f"},
        "labels": [{"shape": "cube", "color": "Red", "material": "metal"}, {"shape": "sphere"}], "least_score": 0.7,
        "coordinates": "relative", "size": [640, 480]}"#;

    fn wrong(text: &str) -> Vec<String> {
        match DetectorContract::parse(text) {
            Err(DetectorError::Fields(wrong)) => wrong.into_iter().map(|(field, _)| field).collect(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_contract_is_read_and_what_it_does_not_state_has_a_default() {
        let read = DetectorContract::parse(BOXES).unwrap();
        assert_eq!(read.regions, RegionOutput::Boxes { name: "b".into(), relative: true });
        assert_eq!(read.outputs(), ["b", "s", "l", "f"]);
        assert_eq!((read.least_score, read.size), (0.7, Some([640, 480])));
        assert_eq!(read.labels[0].color.as_deref(), Some("red"));
        let read =
            DetectorContract::parse(r#"{"output": "masks", "names": {"masks": "m"}, "size": null}"#).unwrap();
        let masks = RegionOutput::Masks { name: "m".into(), logits: true, least_pixels: 1 };
        assert_eq!((read.regions, read.least_score, read.size), (masks, 0.5, None));
        assert!(read.labels.is_empty());
    }

    #[test]
    fn every_wrong_field_is_named() {
        for (from, to, field) in [
            ("\"boxes\", \"names\"", "\"box\", \"names\"", "output"),
            ("\"boxes\": \"b\", ", "", "names.boxes"),
            ("\"scores\": \"s\", ", "", "names.scores"),
            ("\"features\"", "\"feature\"", "names.feature"),
            ("\"s\"", "7", "names.scores"),
            ("\"Red\"", "[1]", "labels[0].color"),
            ("{\"shape\": \"sphere\"}", "\"sphere\"", "labels[1]"),
            ("0.7", "7", "least_score"),
            ("\"relative\"", "\"percent\"", "coordinates"),
            ("[640, 480]", "[640]", "size"),
            ("[640, 480]", "[640, 1e9]", "size"),
            ("\"size\"", "\"sizes\"", "sizes"),
        ] {
            let text = BOXES.replacen(from, to, 1);
            assert!(wrong(&text).contains(&field.to_string()), "{field}: {:?}", wrong(&text));
        }
        assert_eq!(
            wrong(r#"{"output": "masks", "names": 3, "least_pixels": 0}"#),
            ["names", "least_pixels", "names.masks"]
        );
        assert_eq!(
            wrong(r#"{"output": "masks", "names": {"masks": "m", "labels": "l"}, "labels": [{}]}"#),
            ["names.labels"]
        );
        assert_eq!(wrong("{"), ["(file)"]);
        assert_eq!(wrong("[]"), ["(file)"]);
        let said = DetectorContract::parse(&BOXES.replace("\"size\"", "\"sizes\"")).unwrap_err().to_string();
        assert_eq!(said, "sizes: is unknown; did you mean size?");
    }
}
