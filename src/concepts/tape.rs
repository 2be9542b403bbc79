//! Reverse-mode derivatives: a tape of scalar operations, and the sweep that gives the gradient of one of them.
//!
//! The sweep `a_i += a_k dk/di` runs from the last entry to the first (Griewank and Walther, Evaluating Derivatives, 2008, ch. 3).
//! Zero and one are entries 0 and 1, so that products with certain inputs cost nothing, and an operation on operands on which
//! it ran before is the same entry. [`Tape::replay`] computes all entries again for other inputs; a tape on which that would have
//! taken another path says so.

use crate::num::elementary::{exp, ln};
use std::collections::HashMap;

/// An entry of a tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Variable(u32);

/// The constants that every tape starts with.
pub const ZERO: Variable = Variable(0);
pub const ONE: Variable = Variable(1);

/// Least argument of a logarithm or a divisor: keeps the gradients of impossible answers finite.
pub const LEAST: f64 = 1e-9;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum TapeOp {
    Input,
    Add,
    Sub,
    Mul,
    Div,
    Min,
    Exp,
    Ln,
}

impl TapeOp {
    /// Of operands x and y; an operation on one has it as both.
    fn value(self, x: f64, y: f64) -> f64 {
        match self {
            TapeOp::Input => f64::NAN,
            TapeOp::Add => x + y,
            TapeOp::Sub => x - y,
            TapeOp::Mul => x * y,
            TapeOp::Div => x / y.max(LEAST),
            TapeOp::Min => x.min(y),
            TapeOp::Exp => exp(x),
            TapeOp::Ln => ln(x.max(LEAST)),
        }
    }

    /// Derivatives by x and y of the value v.
    fn derivatives(self, x: f64, y: f64, v: f64) -> [f64; 2] {
        match self {
            TapeOp::Input => [0.0, 0.0],
            TapeOp::Add => [1.0, 1.0],
            TapeOp::Sub => [1.0, -1.0],
            TapeOp::Mul => [y, x],
            TapeOp::Div => [1.0 / y.max(LEAST), -v / y.max(LEAST)],
            TapeOp::Min if x <= y => [1.0, 0.0],
            TapeOp::Min => [0.0, 1.0],
            TapeOp::Exp => [v, 0.0],
            TapeOp::Ln => [1.0 / x.max(LEAST), 0.0],
        }
    }
}

/// Scalar operations in the order in which they ran.
#[derive(Debug, Clone)]
pub struct Tape {
    values: Vec<f64>,
    entries: Vec<(TapeOp, [Variable; 2])>,
    known: HashMap<(TapeOp, [Variable; 2]), Variable>,
    constants: Vec<Variable>,
    /// Comparisons that decided what ran: the value is above the limit or not.
    decisions: Vec<(Variable, f64, bool)>,
}

impl Default for Tape {
    fn default() -> Self {
        let mut tape = Tape {
            values: Vec::with_capacity(4096),
            entries: Vec::with_capacity(4096),
            known: HashMap::new(),
            constants: vec![],
            decisions: vec![],
        };
        tape.input(0.0);
        tape.input(1.0);
        tape
    }
}

impl Tape {
    /// A value without operands.
    pub fn input(&mut self, value: f64) -> Variable {
        self.values.push(value);
        self.entries.push((TapeOp::Input, [ZERO, ZERO]));
        Variable(self.entries.len() as u32 - 1)
    }

    /// A value that a replay keeps.
    fn constant(&mut self, value: f64) -> Variable {
        let same = self.constants.iter().find(|v| self.value(**v).to_bits() == value.to_bits());
        match same.copied() {
            Some(known) => known,
            None => {
                let new = self.input(value);
                self.constants.push(new);
                new
            }
        }
    }

    pub fn value(&self, v: Variable) -> f64 {
        self.values.get(v.0 as usize).copied().unwrap_or(f64::NAN)
    }

    /// Number of entries.
    pub fn length(&self) -> usize {
        self.entries.len()
    }

    /// No more operations: only replays follow.
    pub fn finish(&mut self) {
        self.known = HashMap::new();
        self.values.shrink_to_fit();
        self.entries.shrink_to_fit();
    }

    /// Whether a value is above a limit. What runs next may depend on it.
    pub fn is_above(&mut self, v: Variable, limit: f64) -> bool {
        let is = self.value(v) > limit;
        self.decisions.push((v, limit, is));
        is
    }

    /// Computes all values again with other ones of these inputs; whether the operations that ran are the ones to run.
    pub fn replay(&mut self, inputs: impl Iterator<Item = (Variable, f64)>) -> bool {
        for (v, value) in inputs {
            if let Some(slot) = self.values.get_mut(v.0 as usize) {
                *slot = value;
            }
        }
        for (k, (op, [a, b])) in self.entries.iter().enumerate() {
            if *op != TapeOp::Input {
                self.values[k] = op.value(self.values[a.0 as usize], self.values[b.0 as usize]);
            }
        }
        self.decisions.iter().all(|(v, limit, was)| (self.value(*v) > *limit) == *was)
    }

    fn push(&mut self, op: TapeOp, operands: [Variable; 2]) -> Variable {
        if let Some(known) = self.known.get(&(op, operands)) {
            return *known;
        }
        self.values.push(op.value(self.value(operands[0]), self.value(operands[1])));
        self.entries.push((op, operands));
        let new = Variable(self.entries.len() as u32 - 1);
        self.known.insert((op, operands), new);
        new
    }

    pub fn add(&mut self, a: Variable, b: Variable) -> Variable {
        match (a, b) {
            (ZERO, other) | (other, ZERO) => other,
            _ => self.push(TapeOp::Add, [a, b]),
        }
    }

    pub fn sub(&mut self, a: Variable, b: Variable) -> Variable {
        match (a, b) {
            (_, ZERO) => a,
            (ONE, ONE) => ZERO,
            _ => self.push(TapeOp::Sub, [a, b]),
        }
    }

    pub fn mul(&mut self, a: Variable, b: Variable) -> Variable {
        match (a, b) {
            (ZERO, _) | (_, ZERO) => ZERO,
            (ONE, other) | (other, ONE) => other,
            _ => self.push(TapeOp::Mul, [a, b]),
        }
    }

    /// a/b; a divisor below [`LEAST`] counts as that.
    pub fn div(&mut self, a: Variable, b: Variable) -> Variable {
        if b == ONE || a == ZERO { a } else { self.push(TapeOp::Div, [a, b]) }
    }

    pub fn min(&mut self, a: Variable, b: Variable) -> Variable {
        match (a, b) {
            (ZERO | ONE, ZERO | ONE) => {
                if self.value(a) <= self.value(b) {
                    a
                } else {
                    b
                }
            }
            _ => self.push(TapeOp::Min, [a, b]),
        }
    }

    pub fn exp(&mut self, a: Variable) -> Variable {
        self.push(TapeOp::Exp, [a, a])
    }

    /// ln a; an argument below [`LEAST`] counts as that.
    pub fn ln(&mut self, a: Variable) -> Variable {
        self.push(TapeOp::Ln, [a, a])
    }

    /// c a.
    pub fn scale(&mut self, a: Variable, c: f64) -> Variable {
        let c = self.constant(c);
        self.mul(a, c)
    }

    /// 1 - a.
    pub fn complement(&mut self, a: Variable) -> Variable {
        if a == ZERO { ONE } else { self.sub(ONE, a) }
    }

    pub fn sum(&mut self, terms: &[Variable]) -> Variable {
        terms.iter().fold(ZERO, |sum, t| self.add(sum, *t))
    }

    /// ln sum_i e^(a_i). A replay keeps the shift by the largest value, which changes nothing but the rounding while the sum stays
    /// between [`LEAST`] and the largest number; beyond these the tape is to be recorded again.
    pub fn log_sum_exp(&mut self, a: &[Variable]) -> Variable {
        let largest = a.iter().map(|v| self.value(*v)).fold(f64::NEG_INFINITY, f64::max);
        let shift = self.constant(largest);
        let mut terms = vec![];
        for v in a {
            let moved = self.sub(*v, shift);
            terms.push(self.exp(moved));
        }
        let sum = self.sum(&terms);
        self.is_above(sum, LEAST);
        self.is_above(sum, f64::MAX);
        let log = self.ln(sum);
        self.add(log, shift)
    }

    /// e^(a_i) / sum_j e^(a_j).
    pub fn softmax(&mut self, a: &[Variable]) -> Vec<Variable> {
        let all = self.log_sum_exp(a);
        let of = |tape: &mut Tape, v: &Variable| {
            let moved = tape.sub(*v, all);
            tape.exp(moved)
        };
        a.iter().map(|v| of(self, v)).collect()
    }

    /// Derivatives of `output` by each of `inputs`.
    pub fn gradient(&self, output: Variable, inputs: &[Variable]) -> Vec<f64> {
        let mut adjoint = vec![0.0; self.entries.len()];
        if let Some(seed) = adjoint.get_mut(output.0 as usize) {
            *seed = 1.0;
        }
        for (k, (op, [a, b])) in self.entries.iter().enumerate().rev() {
            let of_value = adjoint[k];
            if of_value != 0.0 && *op != TapeOp::Input {
                let (a, b) = (a.0 as usize, b.0 as usize);
                let [da, db] = op.derivatives(self.values[a], self.values[b], self.values[k]);
                adjoint[a] += of_value * da;
                adjoint[b] += of_value * db;
            }
        }
        inputs.iter().map(|v| adjoint.get(v.0 as usize).copied().unwrap_or(0.0)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A function that uses every operation.
    fn all_operations(tape: &mut Tape, x: &[Variable]) -> Variable {
        let product = tape.mul(x[0], x[1]);
        let square = tape.mul(x[2], x[2]);
        let positive = tape.add(square, ONE);
        let quotient = tape.div(product, positive);
        let log = tape.ln(positive);
        let soft = tape.softmax(x);
        let mix = tape.mul(soft[1], quotient);
        let smaller = tape.min(product, log);
        let all = tape.log_sum_exp(&[mix, smaller, x[3]]);
        let rest = tape.complement(soft[3]);
        let scaled = tape.scale(rest, -2.5);
        let terms = tape.sum(&[all, scaled, mix]);
        let e = tape.exp(quotient);
        let both = tape.sub(terms, rest);
        tape.add(both, e)
    }

    fn value(x: &[f64]) -> f64 {
        let mut tape = Tape::default();
        let inputs: Vec<Variable> = x.iter().map(|v| tape.input(*v)).collect();
        let y = all_operations(&mut tape, &inputs);
        tape.value(y)
    }

    proptest! {
        #[test]
        fn gradients_are_central_differences(x in prop::collection::vec(-2.0..2.0f64, 4)) {
            let mut tape = Tape::default();
            let inputs: Vec<Variable> = x.iter().map(|v| tape.input(*v)).collect();
            let y = all_operations(&mut tape, &inputs);
            let gradient = tape.gradient(y, &inputs);
            for (k, slope) in gradient.iter().enumerate() {
                let moved = |h: f64| { let mut x = x.clone(); x[k] += h; value(&x) };
                let (fine, coarse) = ((moved(1e-6) - moved(-1e-6)) / 2e-6, (moved(1e-5) - moved(-1e-5)) / 2e-5);
                // Across a kink of min or max the differences disagree with each other.
                prop_assume!((fine - coarse).abs() < 1e-5);
                prop_assert!((fine - slope).abs() < 1e-6 * (1.0 + slope.abs()) + 1e-7, "{k}: {fine} {slope}");
            }
        }

        #[test]
        fn a_replay_is_the_run_with_the_other_inputs(
            x in prop::collection::vec(-2.0..2.0f64, 4),
            y in prop::collection::vec(-2.0..2.0f64, 4),
        ) {
            let mut tape = Tape::default();
            let inputs: Vec<Variable> = x.iter().map(|v| tape.input(*v)).collect();
            let output = all_operations(&mut tape, &inputs);
            let is_large = tape.is_above(output, 1.0);
            let same = tape.replay(inputs.iter().copied().zip(y.iter().copied()));
            let expected = value(&y);
            prop_assert!((tape.value(output) - expected).abs() < 1e-12 * (1.0 + expected.abs()));
            prop_assert_eq!(same, (tape.value(output) > 1.0) == is_large);
        }
    }

    /// The shift of the recorded run makes their sum vanish, or overflow.
    #[test]
    fn a_replay_far_from_the_recorded_run_asks_for_another_one() {
        let mut tape = Tape::default();
        let inputs = [tape.input(0.0), tape.input(1.0)];
        let output = tape.log_sum_exp(&inputs);
        let mut replay = |a: f64| tape.replay(inputs.iter().copied().zip([a, a]));
        assert!(replay(-10.0) && replay(5.0));
        assert!(!replay(-30.0) && !replay(800.0));
        assert!(tape.value(output).is_infinite());
    }
}
