//! A parsed formula as a list of instructions, run on one number of any scalar or on many numbers at once.

use crate::body::{Body, Wrench};
use crate::num::{Real, Vec2, elementary, vec2};
use smallvec::SmallVec;

pub(super) const VARIABLES: [&str; 10] = ["x", "y", "vx", "vy", "speed", "yaw", "spin", "t", "m", "r"];
/// Index of the time among them.
const TIME: usize = 7;
/// Shortest time in which a law of the time may change much (s).
const PACE: f64 = 0.02;
/// Largest acceleration that counts as one (m/s^2, rad/s^2): beyond, the formula has run away.
const LARGEST: f64 = 1e6;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Instruction {
    Number(f64),
    /// Index among [`VARIABLES`].
    Variable(usize),
    Parameter(usize),
    Negate,
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Sin,
    Cos,
    Tan,
    Exp,
    Ln,
    Sqrt,
    Tanh,
    Abs,
    Sign,
    Min,
    Max,
}

impl Instruction {
    /// Whether it takes two numbers and gives one.
    fn takes_two(self) -> bool {
        use Instruction::*;
        matches!(self, Add | Subtract | Multiply | Divide | Power | Min | Max)
    }
}

/// Names, numbers of arguments, and what they do.
pub(super) const FUNCTIONS: [(&str, usize, Instruction); 11] = [
    ("sin", 1, Instruction::Sin),
    ("cos", 1, Instruction::Cos),
    ("tan", 1, Instruction::Tan),
    ("exp", 1, Instruction::Exp),
    ("ln", 1, Instruction::Ln),
    ("sqrt", 1, Instruction::Sqrt),
    ("tanh", 1, Instruction::Tanh),
    ("abs", 1, Instruction::Abs),
    ("sign", 1, Instruction::Sign),
    ("min", 2, Instruction::Min),
    ("max", 2, Instruction::Max),
];
pub(super) const TARGETS: [&str; 5] = ["ax", "ay", "fx", "fy", "torque"];

/// A formula that has been read: for each target, its steps in postfix order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FormulaProgram {
    pub(super) steps: [Vec<Instruction>; 5],
}

/// Force (N) and torque (N m) on a body.
pub type ForceAndTorque<T = f64> = (Vec2<T>, T);

impl FormulaProgram {
    /// The shortest time in which the law may change much by itself (s).
    pub fn pace(&self) -> f64 {
        let steady = !self.steps.iter().flatten().any(|s| *s == Instruction::Variable(TIME));
        if steady { f64::INFINITY } else { PACE }
    }

    /// Adds to the wrench on `body`; `false`, and nothing added, where a formula has no finite value.
    #[must_use]
    pub fn force<T: Real>(&self, p: &[T], time: T, body: &Body<T>, out: &mut Wrench<T>) -> bool {
        let variables = variables(time, body);
        let values = self.steps.each_ref().map(|steps| run(steps, &variables, p));
        let Some((force, torque)) = push(values, body) else { return false };
        out.force += force;
        out.torque += torque;
        true
    }

    /// What it does to one body at each of several instants; `None` where a formula has no finite value.
    pub fn pushes(&self, p: &[f64], instants: &[(f64, Body<f64>)]) -> Vec<Option<ForceAndTorque>> {
        let rows: Vec<_> = instants.iter().map(|(time, body)| variables(*time, body)).collect();
        let column = |k: usize| ValueColumn::Each(rows.iter().map(|row| row[k]).collect());
        let variables: [ValueColumn; VARIABLES.len()] = std::array::from_fn(column);
        let p: Vec<ValueColumn> = p.iter().map(|&v| ValueColumn::Alike(v)).collect();
        let values = self.steps.each_ref().map(|steps| run(steps, &variables, &p));
        let at = |k: usize| values.each_ref().map(|column| column.at(k));
        instants.iter().enumerate().map(|(k, (_, body))| push(at(k), body)).collect()
    }
}

/// In the order of [`VARIABLES`].
fn variables<T: Real>(time: T, body: &Body<T>) -> [T; VARIABLES.len()] {
    let radius = T::constant(body.shape.bounding_radius());
    let (Vec2 { x, y }, v) = (body.position, body.velocity);
    [x, y, v.x, v.y, v.norm(), body.yaw, body.spin, time, body.mass, radius]
}

/// Of the values of the targets, if all are finite.
fn push<T: Real>([ax, ay, fx, fy, torque]: [T; 5], body: &Body<T>) -> Option<ForceAndTorque<T>> {
    let force = vec2(ax, ay) * body.mass + vec2(fx, fy);
    let (mass, inertia) = (body.mass.value(), body.inertia().value());
    let parts = [force.x.value() / mass, force.y.value() / mass, torque.value() / inertia];
    // At a kink there is a value without a slope.
    let smooth = |v: T| if v.is_finite() { v } else { T::constant(v.value()) };
    let finite = parts.iter().all(|a| a.abs() <= LARGEST);
    finite.then(|| (vec2(smooth(force.x), smooth(force.y)), smooth(torque)))
}

/// A value that instructions work on.
trait Operand<T>: Clone {
    fn constant(value: T) -> Self;
    fn map(self, f: impl Fn(T) -> T) -> Self;
    fn with(self, other: Self, f: impl Fn(T, T) -> T) -> Self;
}

impl<T: Real> Operand<T> for T {
    fn constant(value: T) -> T {
        value
    }
    fn map(self, f: impl Fn(T) -> T) -> T {
        f(self)
    }
    fn with(self, other: T, f: impl Fn(T, T) -> T) -> T {
        f(self, other)
    }
}

/// Many numbers, to each of which an instruction is applied.
#[derive(Clone)]
enum ValueColumn {
    /// All numbers are this one.
    Alike(f64),
    Each(Vec<f64>),
}

impl ValueColumn {
    fn at(&self, k: usize) -> f64 {
        match self {
            ValueColumn::Alike(value) => *value,
            ValueColumn::Each(values) => values[k],
        }
    }
}

impl Operand<f64> for ValueColumn {
    fn constant(value: f64) -> ValueColumn {
        ValueColumn::Alike(value)
    }
    fn map(self, f: impl Fn(f64) -> f64) -> ValueColumn {
        match self {
            ValueColumn::Alike(value) => ValueColumn::Alike(f(value)),
            ValueColumn::Each(mut values) => {
                values.iter_mut().for_each(|v| *v = f(*v));
                ValueColumn::Each(values)
            }
        }
    }
    fn with(self, other: ValueColumn, f: impl Fn(f64, f64) -> f64) -> ValueColumn {
        match (self, other) {
            (ValueColumn::Alike(a), ValueColumn::Alike(b)) => ValueColumn::Alike(f(a, b)),
            (a, ValueColumn::Alike(b)) => a.map(|a| f(a, b)),
            (ValueColumn::Alike(a), b) => b.map(|b| f(a, b)),
            (ValueColumn::Each(mut a), ValueColumn::Each(b)) => {
                a.iter_mut().zip(&b).for_each(|(a, b)| *a = f(*a, *b));
                ValueColumn::Each(a)
            }
        }
    }
}

/// The value of steps in postfix order; zero where there are none.
fn run<T: Real, O: Operand<T>>(steps: &[Instruction], variables: &[O], parameters: &[O]) -> O {
    let mut stack = SmallVec::<[O; 8]>::new();
    let missing = || O::constant(T::constant(f64::NAN));
    for step in steps {
        let mut pop = || stack.pop().unwrap_or_else(missing);
        let value = match *step {
            Instruction::Number(v) => O::constant(T::constant(v)),
            Instruction::Variable(i) => variables.get(i).cloned().unwrap_or_else(missing),
            Instruction::Parameter(i) => parameters.get(i).cloned().unwrap_or_else(missing),
            operator if operator.takes_two() => {
                let (b, a) = (pop(), pop());
                match operator {
                    Instruction::Add => a.with(b, |a, b| a + b),
                    Instruction::Subtract => a.with(b, |a, b| a - b),
                    Instruction::Multiply => a.with(b, |a, b| a * b),
                    Instruction::Divide => a.with(b, |a, b| a / b),
                    Instruction::Power => a.with(b, power),
                    Instruction::Min => a.with(b, T::min),
                    _ => a.with(b, T::max),
                }
            }
            function => pop().map(|v| of_one(function, v)),
        };
        stack.push(value);
    }
    stack.pop().unwrap_or_else(|| O::constant(T::zero()))
}

/// Whether a part of the steps that no variable and no parameter enters has no finite value, such as 9^9^9, or the whole of an
/// acceleration is a constant beyond [`LARGEST`].
pub(super) fn has_runaway_constant(steps: &[Instruction], is_acceleration: bool) -> bool {
    let mut stack = SmallVec::<[Option<f64>; 8]>::new();
    for step in steps {
        let value = match *step {
            Instruction::Variable(_) | Instruction::Parameter(_) => None,
            Instruction::Number(v) => Some(v),
            step => {
                let last = stack.pop().flatten();
                if step == Instruction::Divide && last == Some(0.0) {
                    return true;
                }
                let first = if step.takes_two() { stack.pop().flatten() } else { Some(0.0) };
                first.zip(last).map(|(a, b)| {
                    let given: &[Instruction] = &[Instruction::Number(a), Instruction::Number(b), step];
                    run(given, &[], &[])
                })
            }
        };
        if value.is_some_and(|v: f64| !v.is_finite()) {
            return true;
        }
        stack.push(value);
    }
    is_acceleration && stack.pop().flatten().is_some_and(|v| v.abs() > LARGEST)
}

/// A function of one argument.
fn of_one<T: Real>(function: Instruction, v: T) -> T {
    match function {
        Instruction::Negate => -v,
        Instruction::Sin => v.sin(),
        Instruction::Cos => v.cos(),
        Instruction::Tan => v.sin() / v.cos(),
        Instruction::Exp => v.exp(),
        Instruction::Ln => v.ln(),
        Instruction::Sqrt if v.value() == 0.0 => T::zero(),
        Instruction::Sqrt => v.sqrt(),
        Instruction::Tanh => v.tanh(),
        Instruction::Abs => v.abs(),
        _ if v.value() == 0.0 => T::zero(),
        _ => T::constant(v.value().signum()),
    }
}

/// a^b; the slope by the exponent is ln(a) a^b.
fn power<T: Real>(a: T, b: T) -> T {
    let (x, n) = (a.value(), b.value());
    // Squares and cubes are most of them.
    let raised = |n: f64| {
        if n.fract() == 0.0 && n.abs() <= 4.0 {
            elementary::powi(x, n as i32)
        } else {
            elementary::powf(x, n)
        }
    };
    let value = raised(n);
    if !T::DIFFERENTIATES {
        return T::constant(value);
    }
    if b.is_constant() {
        let slope = n * raised(n - 1.0);
        return if slope.is_finite() { a.chain(value, slope) } else { T::constant(value) };
    }
    if x <= 0.0 {
        return T::constant(value);
    }
    a.chain(value, n * raised(n - 1.0)) + b.infinitesimal() * (value * elementary::ln(x))
}

#[cfg(test)]
mod tests {
    use super::super::Formula;
    use super::*;
    use crate::scene::Shape;

    #[test]
    fn many_instants_at_once_are_as_one_by_one() {
        let text = "let k = 0.3; let turn = 0.4; ax = -k*vx*max(speed, 0.01)^1.5 + cos(turn)*x^2 - ln(t); \
                    fy = min(y, k)/sqrt(m) + sign(x)*abs(spin) + exp(-r)*tanh(yaw); torque = tan(y) - 2*sin(t)";
        let program = Formula::new(text, vec![]).expect("it is one").read().expect("it is one");
        let instant = |k: usize| {
            let k = k as f64;
            let body = Body {
                shape: Shape::Square { half_side: 0.2 },
                mass: 0.7,
                position: vec2(0.3 * k - 0.8, 0.2 - 0.1 * k),
                yaw: 0.1 * k,
                velocity: vec2(0.2 * k, 0.5 - 0.2 * k),
                spin: 0.3 - 0.1 * k,
                roll: Vec2::zero(),
            };
            (0.1 * k, body)
        };
        let instants: Vec<(f64, Body<f64>)> = (0..6).map(instant).collect();
        let all = program.pushes(&[0.3, 0.4], &instants);
        assert_eq!(all.iter().filter(|push| push.is_none()).count(), 1, "the logarithm of none");
        for ((time, body), push) in instants.iter().zip(all) {
            let mut out = Wrench::zero();
            let defined = program.force(&[0.3, 0.4], *time, body, &mut out);
            assert_eq!(push, defined.then_some((out.force, out.torque)), "{time}");
        }
    }
}
