//! Names of a model's values: `effect.parameter[label]`, where the label says who has the value.

use std::fmt;

/// The name of one value of an effect: `sliding_friction.mu`, `sliding_friction.mu[rubber]`, `restitution.deviation[3-5]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ParamId<'a> {
    pub effect: &'a str,
    pub parameter: &'a str,
    /// Who has the value: a material, a shape, an object's id, two ids joined by `-`; empty where all share it.
    pub label: &'a str,
}

impl<'a> ParamId<'a> {
    /// Reads a name; `None` of one that is no effect's value, such as `objects[3].mass`.
    pub fn parse(name: &'a str) -> Option<Self> {
        let (effect, rest) = name.split_once('.')?;
        let (parameter, label) = match rest.split_once('[') {
            Some((parameter, label)) => (parameter, label.strip_suffix(']')?),
            None => (rest, ""),
        };
        let word = |text: &str| !text.is_empty() && !text.contains(['[', ']', '.']);
        (word(effect) && word(parameter)).then_some(ParamId { effect, parameter, label })
    }

    /// The name of the parameter, whoever has the value.
    pub fn stem(self) -> Self {
        ParamId { label: "", ..self }
    }

    /// Whether it is a value of this parameter, whoever has it.
    pub fn is_of(&self, effect: &str, parameter: &str) -> bool {
        self.effect == effect && self.parameter == parameter
    }

    /// The object that has the value, where it is one object's own.
    pub fn object(&self) -> Option<u32> {
        self.label.parse().ok()
    }

    /// Whether the label names this object, alone or in a pair.
    pub fn concerns(&self, object: u32) -> bool {
        self.label.split('-').any(|part| part.parse() == Ok(object))
    }
}

impl fmt::Display for ParamId<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}.{}", self.effect, self.parameter)?;
        if self.label.is_empty() { Ok(()) } else { write!(f, "[{}]", self.label) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_printed() {
        let check = |name: &str, effect: &str, parameter: &str, label: &str| {
            let id = ParamId::parse(name);
            assert_eq!(id, Some(ParamId { effect, parameter, label }), "{name}");
            assert_eq!(id.map(|id| id.to_string()).as_deref(), Some(name));
        };
        check("sliding_friction.mu", "sliding_friction", "mu", "");
        check("sliding_friction.mu[rubber v1.2]", "sliding_friction", "mu", "rubber v1.2");
        check("restitution.deviation[3-5]", "restitution", "deviation", "3-5");
        check("damping.linear[12]", "damping", "linear", "12");
        for name in ["", "mu", "objects[3].mass", ".mu", "a.", "a.b.c", "a.b[c"] {
            assert_eq!(ParamId::parse(name), None, "{name}");
        }
        let pair = ParamId::parse("restitution.deviation[3-15]").expect("it is a name");
        assert_eq!([3, 5, 15].map(|id| pair.concerns(id)), [true, false, true]);
        assert_eq!((pair.object(), ParamId { label: "15", ..pair }.object()), (None, Some(15)));
    }
}
