//! Values of a soft program: sets with probabilities of membership, and distributions over exact values.

use super::tape::{ONE, Tape, Variable, ZERO};
use crate::reason::{ProgramValue, SceneEvent};

/// A value on the stack of a soft program.
#[derive(Debug, Clone)]
pub enum SoftValue {
    /// Probability that each object of the scene is in the set; independent.
    Objects(Vec<Variable>),
    /// Events, each with the probability that it is in the set; independent.
    Events(Vec<(SceneEvent, Variable)>),
    /// Any other value: exactly one of these, with its probability.
    Choice(Vec<(ProgramValue, Variable)>),
}

impl SoftValue {
    /// A value that is certain.
    pub fn certain(value: ProgramValue, objects: usize) -> SoftValue {
        match value {
            ProgramValue::Objects(of) => {
                let member = |k: usize| if of.contains(&k) { ONE } else { ZERO };
                SoftValue::Objects((0..objects).map(member).collect())
            }
            ProgramValue::Events(events) => SoftValue::Events(events.into_iter().map(|e| (e, ONE)).collect()),
            other => SoftValue::Choice(vec![(other, ONE)]),
        }
    }
}

/// Adds the probability of a value to a distribution.
pub fn add_choice(
    tape: &mut Tape,
    choices: &mut Vec<(ProgramValue, Variable)>,
    value: ProgramValue,
    p: Variable,
) {
    if p == ZERO {
        return;
    }
    match choices.iter_mut().find(|(known, _)| *known == value) {
        Some((_, sum)) => *sum = tape.add(*sum, p),
        None => choices.push((value, p)),
    }
}

/// Divides by the sum: the distribution given that the operation has a result. Returns that sum, too.
pub fn normalised(
    tape: &mut Tape,
    choices: Vec<(ProgramValue, Variable)>,
) -> (Vec<(ProgramValue, Variable)>, Variable) {
    let all: Vec<Variable> = choices.iter().map(|c| c.1).collect();
    let sum = tape.sum(&all);
    (choices.into_iter().map(|(v, p)| (v, tape.div(p, sum))).collect(), sum)
}

/// P(at least one of independent members).
pub fn any(tape: &mut Tape, members: &[Variable]) -> Variable {
    let none = none_of(tape, members);
    tape.complement(none)
}

/// P(none of independent members).
pub fn none_of(tape: &mut Tape, members: &[Variable]) -> Variable {
    members.iter().fold(ONE, |product, m| {
        let absent = tape.complement(*m);
        tape.mul(product, absent)
    })
}

/// P(only member k), for each k.
pub fn only_one(tape: &mut Tape, members: &[Variable]) -> Vec<Variable> {
    let absent: Vec<Variable> = members.iter().map(|m| tape.complement(*m)).collect();
    let n = members.len();
    let (mut before, mut after) = (vec![ONE; n + 1], vec![ONE; n + 1]);
    for k in 0..n {
        before[k + 1] = tape.mul(before[k], absent[k]);
        after[n - 1 - k] = tape.mul(after[n - k], absent[n - 1 - k]);
    }
    (0..n)
        .map(|k| {
            let others = tape.mul(before[k], after[k + 1]);
            tape.mul(others, members[k])
        })
        .collect()
}

/// P(exactly k members), k = 0..=n: the Poisson binomial distribution by recursion over the members.
pub fn counts(tape: &mut Tape, members: &[Variable]) -> Vec<Variable> {
    let mut counts = vec![ONE];
    for m in members.iter().filter(|m| **m != ZERO) {
        let absent = tape.complement(*m);
        let mut next = vec![ZERO; counts.len() + 1];
        for (k, p) in counts.iter().enumerate() {
            let (stay, more) = (tape.mul(*p, absent), tape.mul(*p, *m));
            next[k] = tape.add(next[k], stay);
            next[k + 1] = tape.add(next[k + 1], more);
        }
        counts = next;
    }
    counts
}
