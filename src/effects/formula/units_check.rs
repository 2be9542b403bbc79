//! The units of a formula: both sides must agree; a parameter without a unit gets the one that follows.
//!
//! A number carries no unit where a parameter multiplies it, and any unit elsewhere, as in `ax = 0.1`.

use super::error::FormulaError;
use super::parameter::FormulaParameter;
use super::program::{FormulaProgram, Instruction, TARGETS, VARIABLES};
use super::unit::{Dimension, dimension};
use crate::num::elementary;

/// Units of the left sides and of the variables, in their order.
const TARGET_UNITS: [&str; 5] = ["m/s^2", "m/s^2", "N", "N", "N m"];
const VARIABLE_UNITS: [&str; VARIABLES.len()] = ["m", "m", "m/s", "m/s", "m/s", "1", "1/s", "s", "kg", "m"];
/// A parameter without a unit.
const NO_UNIT: &str = "1";

/// What is known of the unit of a part of a formula.
#[derive(Debug, Clone, PartialEq)]
struct PartUnit {
    /// Of the variables and the parameters with units.
    known: Dimension,
    /// Powers of the parameters whose units are not known.
    powers: Vec<f64>,
    /// Powers of the parameters with units.
    declared: Vec<f64>,
    /// Whether the unit depends on a number's value or cannot be said.
    is_open: bool,
    /// The number, where it is one.
    value: Option<f64>,
}

impl PartUnit {
    fn of(known: Dimension, parameters: usize) -> PartUnit {
        let none = vec![0.0; parameters];
        PartUnit { known, powers: none.clone(), declared: none, is_open: false, value: None }
    }

    fn number(value: Option<f64>, parameters: usize) -> PartUnit {
        PartUnit { value, ..PartUnit::of(Dimension::default(), parameters) }
    }

    /// Whether a parameter takes part: then numbers are pure.
    fn has_parameter(&self) -> bool {
        self.powers.iter().chain(&self.declared).any(|p| *p != 0.0)
    }

    /// This times the power of another.
    fn times(mut self, other: &PartUnit, power: f64) -> PartUnit {
        self.known = self.known.times(other.known, power);
        for (mine, theirs) in [(&mut self.powers, &other.powers), (&mut self.declared, &other.declared)] {
            mine.iter_mut().zip(theirs).for_each(|(a, b)| *a += power * b);
        }
        self.is_open |= other.is_open;
        self.value = None;
        self
    }
}

/// Where two units must be equal.
#[derive(Clone, Copy, PartialEq)]
enum UnitPlace {
    /// Left and right side.
    Sides,
    /// The terms of a sum.
    Sum,
    /// The argument of a function or an exponent, which is a number.
    Argument,
}

/// Two parts whose units must be equal, in the formula of one left side.
struct UnitEquation {
    target: usize,
    place: UnitPlace,
    left: PartUnit,
    right: PartUnit,
}

/// The parameters with the units that follow from the formulas.
///
/// # Errors
/// The declared unit of a parameter contradicts a formula.
pub fn with_units(
    program: &FormulaProgram,
    mut parameters: Vec<FormulaParameter>,
) -> Result<Vec<FormulaParameter>, FormulaError> {
    let mut equations = vec![];
    for (target, steps) in program.steps.iter().enumerate().filter(|(_, steps)| !steps.is_empty()) {
        if let Some(found) = unit_of(steps, &parameters, target, &mut equations) {
            let wanted = dimension(TARGET_UNITS[target]).unwrap_or_default();
            let left = PartUnit::of(wanted, parameters.len());
            equations.push(UnitEquation { target, place: UnitPlace::Sides, left, right: found });
        }
    }
    // A parameter without a unit: the first formula that has no other such parameter says its unit.
    let mut units: Vec<Option<Dimension>> = vec![None; parameters.len()];
    loop {
        let next = equations.iter().find_map(|e| e.solved(&units));
        let Some((k, unit)) = next else { break };
        units[k] = Some(unit);
    }
    for (parameter, unit) in parameters.iter_mut().zip(&units) {
        if let Some(unit) = unit.filter(|unit| !unit.is_number()) {
            parameter.unit = unit.text();
        }
    }
    match equations.iter().find_map(|e| e.contradiction(&parameters)) {
        Some(error) => Err(error),
        None => Ok(parameters),
    }
}

impl UnitEquation {
    /// What the right side has more than the left.
    fn difference(&self) -> PartUnit {
        self.right.clone().times(&self.left, -1.0)
    }

    /// Whether it says something: bare variables and numbers may carry any unit in a number that multiplies them.
    fn binds(&self) -> bool {
        let is_strict = self.place != UnitPlace::Sum || self.left.has_parameter();
        !self.left.is_open && !self.right.is_open && is_strict && self.right.has_parameter()
    }

    /// The parameter whose unit follows, with its unit.
    fn solved(&self, units: &[Option<Dimension>]) -> Option<(usize, Dimension)> {
        let mut difference = self.difference();
        if !self.binds() {
            return None;
        }
        for (power, unit) in difference.powers.iter_mut().zip(units) {
            if let Some(unit) = unit {
                difference.known = difference.known.times(*unit, *power);
                *power = 0.0;
            }
        }
        let mut unknown = difference.powers.iter().enumerate().filter(|(_, p)| **p != 0.0);
        match (unknown.next(), unknown.next()) {
            (Some((k, power)), None) => Some((k, difference.known.power(-1.0 / power))),
            _ => None,
        }
    }

    /// The error, if units contradict each other although all parameters in it have declared ones.
    fn contradiction(&self, parameters: &[FormulaParameter]) -> Option<FormulaError> {
        let difference = self.difference();
        if !self.binds() || difference.powers.iter().any(|p| *p != 0.0) || difference.known.is_number() {
            return None;
        }
        let (k, power) = difference.declared.iter().enumerate().rfind(|(_, p)| **p != 0.0)?;
        let parameter = parameters.get(k)?;
        let own = dimension(&parameter.unit)?;
        let (target, left, right) = (TARGETS[self.target], self.left.known.text(), self.right.known.text());
        let problem = match self.place {
            UnitPlace::Sides => format!("{target} is {left}, but the formula gives {right}"),
            UnitPlace::Sum => format!("{target} adds terms of {left} and {right}"),
            UnitPlace::Argument => format!("an exponent or an argument in {target} is {right}, not a number"),
        };
        Some(FormulaError::Mismatch {
            problem,
            name: parameter.name.clone(),
            unit: parameter.unit.clone(),
            needed: own.times(difference.known, -1.0 / power).text(),
        })
    }
}

/// The unit of a formula in postfix order; its inner conditions go to `equations`.
fn unit_of(
    steps: &[Instruction],
    parameters: &[FormulaParameter],
    target: usize,
    equations: &mut Vec<UnitEquation>,
) -> Option<PartUnit> {
    use Instruction::{Abs, Add, Cos, Divide, Exp, Ln, Max, Min, Multiply, Negate, Number, Power, Sign, Sin};
    use Instruction::{Parameter, Sqrt, Subtract, Tan, Tanh, Variable};
    let count = parameters.len();
    let mut stack: Vec<PartUnit> = vec![];
    for step in steps {
        let part = match *step {
            Number(value) => PartUnit::number(Some(value), count),
            Variable(i) => PartUnit::of(dimension(VARIABLE_UNITS.get(i)?)?, count),
            Parameter(i) => of_parameter(i, parameters)?,
            Negate => {
                let part = stack.pop()?;
                PartUnit { value: part.value.map(|v| -v), ..part }
            }
            Abs => PartUnit { value: None, ..stack.pop()? },
            Sqrt => PartUnit::number(None, count).times(&stack.pop()?, 0.5),
            Sin | Cos | Tan | Exp | Ln | Tanh => {
                let (left, right) = (PartUnit::number(None, count), stack.pop()?);
                equations.push(UnitEquation { target, place: UnitPlace::Argument, left, right });
                PartUnit::number(None, count)
            }
            Sign => {
                stack.pop()?;
                PartUnit::number(None, count)
            }
            Add | Subtract | Min | Max => {
                let (right, left) = (stack.pop()?, stack.pop()?);
                added(left, right, target, equations)
            }
            Multiply | Divide => {
                let (right, left) = (stack.pop()?, stack.pop()?);
                let sign = if *step == Divide { -1.0 } else { 1.0 };
                let value = left.value.zip(right.value).map(|(a, b)| if sign > 0.0 { a * b } else { a / b });
                PartUnit { value, ..left.times(&right, sign) }
            }
            Power => {
                let (exponent, base) = (stack.pop()?, stack.pop()?);
                raised(base, exponent, target, equations)
            }
        };
        stack.push(part);
    }
    stack.pop()
}

fn of_parameter(i: usize, parameters: &[FormulaParameter]) -> Option<PartUnit> {
    let parameter = parameters.get(i)?;
    let mut part = PartUnit::of(dimension(&parameter.unit)?, parameters.len());
    let powers = if parameter.unit == NO_UNIT { &mut part.powers } else { &mut part.declared };
    *powers.get_mut(i)? = 1.0;
    Some(part)
}

/// Terms of a sum have one unit; a number has that of the other.
fn added(left: PartUnit, right: PartUnit, target: usize, equations: &mut Vec<UnitEquation>) -> PartUnit {
    if left.value.is_some() || right.value.is_some() {
        let value = left.value.zip(right.value).map(|(a, b)| a + b);
        return PartUnit { value, ..if left.value.is_some() { right } else { left } };
    }
    // Bare variables carry a number of any unit.
    let shown = if left.has_parameter() { left.clone() } else { right.clone() };
    equations.push(UnitEquation { target, place: UnitPlace::Sum, left, right });
    shown
}

/// A power; the exponent is a number.
fn raised(base: PartUnit, exponent: PartUnit, target: usize, equations: &mut Vec<UnitEquation>) -> PartUnit {
    let count = base.powers.len();
    match exponent.value {
        Some(value) => {
            let of_number = base.value.map(|b| elementary::powf(b, value));
            PartUnit { value: of_number, ..PartUnit::number(None, count).times(&base, value) }
        }
        None => {
            let is_number = base.known.is_number() && !base.has_parameter();
            let left = PartUnit::number(None, count);
            let place = UnitPlace::Argument;
            equations.push(UnitEquation { target, place, left: left.clone(), right: exponent });
            PartUnit { is_open: !is_number || base.is_open, ..left }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::formula::Formula;

    fn units(text: &str) -> Vec<String> {
        let law = Formula::new(text, vec![]).unwrap_or_else(|e| panic!("{text}: {e}"));
        law.parameters.into_iter().map(|p| p.unit).collect()
    }

    #[test]
    fn a_parameter_without_a_unit_gets_the_one_that_follows() {
        for (text, expected) in [
            ("let k = 0.1; ax = -k*vx; ay = -k*vy", &["1/s"][..]),
            ("let k = 0.1; fx = -0.5*k*vx*speed", &["kg/m"]),
            ("let a; let f; let p; ax = a*sin(2*pi*f*t + p)", &["m/s^2", "1/s", "1"]),
            ("let k; let l = 1 from 0.1 to 9; ax = k*exp(-x/l)", &["m/s^2", "m"]),
            ("let c; let n = 2; ax = c*x^n", &["1", "1"]),
            ("let k; ax = -k*vx*max(speed, 0.01)^1.5", &["s^0.5/m^1.5"]),
            ("let k; torque = -k*spin*m*r^2", &["1/s"]),
            ("let k [kg/s] = 1; fx = -k*vx", &["kg/s"]),
            ("let k; let l; ax = k*l*x", &["1", "1"]),
            ("let w [rad/s] = 0; ax = 2*w*vy; ay = -2*w*vx", &["rad/s"]),
        ] {
            assert_eq!(units(text), expected, "{text}");
        }
        // Numbers carry the unit that is missing.
        for text in ["ax = 0.1", "ax = -0.2*vx + 0.1*x", "ax = vx", "fx = sin(t)", "let k; ax = k*x + k*vx"] {
            units(text);
        }
    }

    #[test]
    fn a_declared_unit_that_contradicts_a_formula_is_refused_with_the_right_one() {
        for (text, expected) in [
            (
                "let k [kg] = 0.1; ax = -k*vx",
                "ax is m/s^2, but the formula gives kg m/s; k [kg] would have to be 1/s",
            ),
            ("let c [1/m] = 1; fx = -c*vx*speed", "c [1/m] would have to be kg/m"),
            ("let f [m] = 1; ax = 3*sin(f*t)", "f [m] would have to be 1/s"),
            ("let k [1/s^2] = 1; let c [1/m] = 1; ax = k*x + c*vx", "c [1/m] would have to be 1/s"),
            ("let k [1/s] = 1; ax = (k*x)^2", "k [1/s] would have to be 1/(m^0.5 s)"),
        ] {
            let message = Formula::new(text, vec![]).expect_err(text).to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }
}
