//! Reverse-mode derivatives: a tape of scalar operations, and the sweep that gives the gradient of one of them.
//!
//! Each entry holds its value and up to two operands with the partial derivatives by them; the sweep
//! `a_i += a_k dk/di` runs from the last entry to the first (Griewank and Walther, Evaluating Derivatives, 2008, ch. 3). Zero and
//! one are entries 0 and 1, so that products with certain inputs cost nothing.

use crate::num::elementary;

/// An entry of a tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Variable(u32);

/// The constants that every tape starts with.
pub const ZERO: Variable = Variable(0);
pub const ONE: Variable = Variable(1);

/// Least argument of a logarithm or a divisor: keeps the gradients of impossible answers finite.
pub const LEAST: f64 = 1e-9;

#[derive(Debug, Clone, Copy)]
struct Entry {
    value: f64,
    /// Operands; an unused one is [`ZERO`] with the derivative 0.
    operands: [Variable; 2],
    derivatives: [f64; 2],
}

/// Scalar operations in the order in which they ran.
#[derive(Debug, Clone)]
pub struct Tape {
    entries: Vec<Entry>,
}

impl Default for Tape {
    fn default() -> Self {
        let mut tape = Tape { entries: Vec::with_capacity(4096) };
        tape.input(0.0);
        tape.input(1.0);
        tape
    }
}

impl Tape {
    /// A value without operands.
    pub fn input(&mut self, value: f64) -> Variable {
        self.push(value, [ZERO, ZERO], [0.0, 0.0])
    }

    pub fn value(&self, v: Variable) -> f64 {
        self.entries.get(v.0 as usize).map_or(f64::NAN, |e| e.value)
    }

    fn push(&mut self, value: f64, operands: [Variable; 2], derivatives: [f64; 2]) -> Variable {
        self.entries.push(Entry { value, operands, derivatives });
        Variable(self.entries.len() as u32 - 1)
    }

    pub fn add(&mut self, a: Variable, b: Variable) -> Variable {
        match (a, b) {
            (ZERO, other) | (other, ZERO) => other,
            _ => self.push(self.value(a) + self.value(b), [a, b], [1.0, 1.0]),
        }
    }

    pub fn sub(&mut self, a: Variable, b: Variable) -> Variable {
        match (a, b) {
            (_, ZERO) => a,
            (ONE, ONE) => ZERO,
            _ => self.push(self.value(a) - self.value(b), [a, b], [1.0, -1.0]),
        }
    }

    pub fn mul(&mut self, a: Variable, b: Variable) -> Variable {
        match (a, b) {
            (ZERO, _) | (_, ZERO) => ZERO,
            (ONE, other) | (other, ONE) => other,
            _ => {
                let (x, y) = (self.value(a), self.value(b));
                self.push(x * y, [a, b], [y, x])
            }
        }
    }

    /// a/b; a divisor below [`LEAST`] counts as that.
    pub fn div(&mut self, a: Variable, b: Variable) -> Variable {
        if b == ONE || a == ZERO {
            return a;
        }
        let (x, y) = (self.value(a), self.value(b).max(LEAST));
        self.push(x / y, [a, b], [1.0 / y, -x / (y * y)])
    }

    pub fn min(&mut self, a: Variable, b: Variable) -> Variable {
        if self.value(a) <= self.value(b) { a } else { b }
    }

    pub fn exp(&mut self, a: Variable) -> Variable {
        let y = elementary::exp(self.value(a));
        self.push(y, [a, ZERO], [y, 0.0])
    }

    /// ln a; an argument below [`LEAST`] counts as that.
    pub fn ln(&mut self, a: Variable) -> Variable {
        let x = self.value(a).max(LEAST);
        self.push(elementary::ln(x), [a, ZERO], [1.0 / x, 0.0])
    }

    /// c a.
    pub fn scale(&mut self, a: Variable, c: f64) -> Variable {
        if a == ZERO { ZERO } else { self.push(c * self.value(a), [a, ZERO], [c, 0.0]) }
    }

    /// 1 - a.
    pub fn complement(&mut self, a: Variable) -> Variable {
        if a == ZERO { ONE } else { self.sub(ONE, a) }
    }

    pub fn sum(&mut self, terms: &[Variable]) -> Variable {
        terms.iter().fold(ZERO, |sum, t| self.add(sum, *t))
    }

    /// ln sum_i e^(a_i).
    pub fn log_sum_exp(&mut self, a: &[Variable]) -> Variable {
        let largest = a.iter().map(|v| self.value(*v)).fold(f64::NEG_INFINITY, f64::max);
        let shift = self.input(largest);
        let mut terms = vec![];
        for v in a {
            let moved = self.sub(*v, shift);
            terms.push(self.exp(moved));
        }
        let sum = self.sum(&terms);
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
        for k in (2..self.entries.len()).rev() {
            let a = adjoint[k];
            if a != 0.0 {
                let Entry { operands, derivatives, .. } = self.entries[k];
                adjoint[operands[0].0 as usize] += a * derivatives[0];
                adjoint[operands[1].0 as usize] += a * derivatives[1];
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
    }
}
