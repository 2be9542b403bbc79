//! Typed fields of JSON objects: what is missing or of a wrong type is reported with its path.

use crate::scene::violations::SceneViolations;
use serde_json::{Map, Value};

/// Reads fields, and collects what is wrong with them. A missing or null field is `None` without a violation, unless the
/// method requires it.
#[derive(Default)]
pub(super) struct JsonFields {
    pub violations: SceneViolations,
}

impl JsonFields {
    /// Two numbers.
    pub(super) fn pair(&mut self, from: &Map<String, Value>, key: &str, path: &str) -> Option<[f64; 2]> {
        let value = from.get(key).filter(|v| !v.is_null())?;
        match self.numbers(Some(value), &join(path, key), &[2])?[..] {
            [a, b] => Some([a, b]),
            _ => None,
        }
    }

    /// A JSON object.
    pub(super) fn object<'a>(&mut self, value: &'a Value, path: &str) -> Option<&'a Map<String, Value>> {
        if value.as_object().is_none() {
            self.violations.add(path, format!("is {}; give an object", type_name(value)));
        }
        value.as_object()
    }

    /// A required list; an empty one where it is missing or wrong.
    pub(super) fn list<'a>(&mut self, from: &'a Map<String, Value>, key: &str, path: &str) -> &'a [Value] {
        match from.get(key) {
            Some(Value::Array(list)) => list,
            other => {
                let found = other.map_or("missing", type_name);
                self.violations.add(join(path, key), format!("is {found}; give a list"));
                &[]
            }
        }
    }

    /// The required id under `object_id`.
    pub(super) fn required_id(&mut self, from: &Map<String, Value>, path: &str) -> Option<u32> {
        let value = from.get("object_id");
        let id = value.and_then(Value::as_u64).and_then(|id| u32::try_from(id).ok());
        if id.is_none() {
            let found = value.map_or("missing", type_name);
            self.violations.add(
                join(path, "object_id"),
                format!("is {found}; give a whole number from 0 to {}", u32::MAX),
            );
        }
        id
    }

    pub(super) fn number(&mut self, from: &Map<String, Value>, key: &str, path: &str) -> Option<f64> {
        let value = from.get(key).filter(|v| !v.is_null())?;
        if value.as_f64().is_none() {
            self.violations.add(join(path, key), format!("is {}; give a number", type_name(value)));
        }
        value.as_f64()
    }

    pub(super) fn text(&mut self, from: &Map<String, Value>, key: &str, path: &str) -> Option<String> {
        let value = from.get(key).filter(|v| !v.is_null())?;
        if value.as_str().is_none() {
            self.violations.add(join(path, key), format!("is {}; give a text", type_name(value)));
        }
        value.as_str().map(str::to_string)
    }

    /// The list of numbers under `features`; empty where there is none.
    pub(super) fn features(&mut self, from: &Map<String, Value>, path: &str) -> Vec<f32> {
        let Some(value) = from.get("features").filter(|v| !v.is_null()) else { return vec![] };
        let length = value.as_array().map_or(0, Vec::len);
        let numbers = self.numbers(Some(value), &join(path, "features"), &[length]);
        numbers.unwrap_or_default().into_iter().map(|f| f as f32).collect()
    }

    /// A required list of numbers with one of these lengths.
    pub(super) fn numbers(
        &mut self,
        value: Option<&Value>,
        path: &str,
        lengths: &[usize],
    ) -> Option<Vec<f64>> {
        let wanted: Vec<String> = lengths.iter().map(usize::to_string).collect();
        let wanted = wanted.join(" or ");
        let Some(Value::Array(list)) = value else {
            let found = value.map_or("missing", type_name);
            self.violations.add(path, format!("is {found}; give {wanted} numbers"));
            return None;
        };
        if !lengths.contains(&list.len()) {
            self.violations.add(path, format!("has {} entries; give {wanted} numbers", list.len()));
            return None;
        }
        let mut numbers = vec![];
        for (i, v) in list.iter().enumerate() {
            match v.as_f64() {
                Some(v) => numbers.push(v),
                None => {
                    self.violations.add(format!("{path}[{i}]"), format!("is {}; give a number", type_name(v)))
                }
            }
        }
        (numbers.len() == list.len()).then_some(numbers)
    }
}

/// The dotted path of a key.
pub(super) fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_string() } else { format!("{path}.{key}") }
}

/// The type of a JSON value, in words.
pub(super) fn type_name(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(n) if n.is_f64() => "a fraction",
        Value::Number(n) if n.is_i64() && !n.is_u64() => "a negative number",
        Value::Number(_) => "a number",
        Value::String(_) => "a text",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}
