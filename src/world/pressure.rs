//! Forces at points that press on each other: none pulls, none slips within its friction.

use super::motion::Rates;
use super::simulate::Few;
use crate::num::{Real, Vec2};
use smallvec::SmallVec;

/// Rate at which a kept contact corrects its gap (1/s).
pub(super) const STIFFNESS: f64 = 25.0;
/// Change of an acceleration that ends sweeps over simultaneous pressure points (m/s^2), and their number at most: first to
/// see which points press and which slip; then, where the equations of these have another answer, to the end.
const SETTLING: [(f64, usize); 3] = [(1e-2, 16), (1e-6, 16), (1e-9, 256)];
/// The same of points that are too many for their equations; and what of it is nothing.
const SWEPT: (f64, usize) = (SETTLED, 16);
const SETTLED: f64 = 1e-6;
/// Most pressure points whose equations are solved; more are swept over only.
const MOST_SOLVED: usize = 24;
/// Share of its own response by which a force must differ from what others can do.
const REDUNDANT: f64 = 1e-4;

/// One point of a kept contact, where a normal force keeps the gap from closing and friction resists the slip.
pub(super) struct PressurePoint<T> {
    /// Index among the touching pairs.
    pub contact: usize,
    /// Which end of the edge, where box meets box.
    pub end: usize,
    pub sides: [Option<Pressed<T>>; 2],
    /// Unit normal from a to b.
    pub normal: Vec2<T>,
    /// Acceleration per force, along the normal and across (1/kg).
    pub response: T,
    pub tangential_response: T,
    /// Opening acceleration that comes from the velocities, and the correction of the gap (m/s^2).
    pub bias: T,
    /// Velocity of b's surface past a's, along `normal.perp()` (m/s).
    pub slip: T,
    /// Most friction in the plane, and friction upwards on a ball's surface, as shares of the normal force.
    pub aside: T,
    pub up: T,
    /// Normal force and tangential force on b (N).
    pub force: T,
    pub rub: T,
    /// Whether friction is at its bound.
    pub slides: bool,
}

/// How one body answers a force at a pressure point.
pub(super) struct Pressed<T> {
    /// Index in the group.
    pub at: usize,
    /// Forces are given as they act on b: -1 for a, 1 for b.
    pub sign: f64,
    /// From its centre to the point, and from the centre that it has with what sticks to it (m).
    pub arm: Vec2<T>,
    pub lever: Vec2<T>,
    /// Places in the group of all that stick together, and where they are from their centre (m); empty for one alone.
    pub carried: Vec<(usize, Vec2<T>)>,
    /// Acceleration of the centre per force, and of the spin per torque.
    pub compliance: T,
    pub inverse_inertia: T,
    /// Radius of a ball, and whether it rolls.
    pub ball: Option<f64>,
    pub rolls: bool,
}

impl<T: Real> PressurePoint<T> {
    /// One step of projected Gauss-Seidel: the force at which the gap stays closed, never a pull, and the friction
    /// that ends the slip, within Coulomb's bound. Gives the largest change of an acceleration (m/s^2).
    fn press(&mut self, rates: &mut [Rates<T>]) -> f64 {
        let opening = self.opening(rates);
        let total = (self.force - opening / self.response).max(T::zero());
        let more = total - self.force;
        self.force = total;
        self.add(rates, more, T::zero());
        let pressed = (more * self.response).value().abs();
        if self.aside.value() == 0.0 && !T::DIFFERENTIATES {
            self.slides = true;
            return pressed;
        }
        let slipping = self.slipping(rates);
        let most = self.aside * self.force;
        let free = self.rub - slipping / self.tangential_response;
        self.slides = free.value().abs() >= most.value();
        let total = free.max(-most).min(most);
        let more = total - self.rub;
        self.rub = total;
        self.add(rates, T::zero(), more);
        pressed.max((more * self.tangential_response).value().abs())
    }

    /// Acceleration at which the gap opens, and that at which the surfaces would have to slip to keep slipping as
    /// they do (m/s^2): zero at a point that presses and at one that does not slip.
    fn opening(&self, rates: &[Rates<T>]) -> T {
        self.bias + self.acceleration(rates, self.normal)
    }

    fn slipping(&self, rates: &[Rates<T>]) -> T {
        self.slip * (2.0 * STIFFNESS) + self.acceleration(rates, self.normal.perp())
    }

    /// Adds what a normal and a tangential force do to the accelerations.
    fn add(&self, rates: &mut [Rates<T>], force: T, rub: T) {
        let push = self.normal * force + self.normal.perp() * rub;
        for s in self.sides.iter().flatten() {
            s.push(rates, push);
            s.lift(&mut rates[s.at], self.normal, self.up * force);
        }
    }

    /// Relative acceleration of the surfaces along a direction (m/s^2).
    fn acceleration(&self, rates: &[Rates<T>], along: Vec2<T>) -> T {
        self.sides.iter().flatten().fold(T::zero(), |sum, s| {
            let r = &rates[s.at];
            sum + along.dot(r.velocity + s.arm.perp() * r.spin) * s.sign
        })
    }
}

/// Finds the forces of the points, which begin at those that they have, and adds what they do to the accelerations. The search
/// looks at real parts only: derivatives follow from the equations of the points that press.
pub(super) fn balance<T: Real>(points: &mut [PressurePoint<T>], rates: &mut [Rates<T>]) {
    if points.len() > MOST_SOLVED {
        points.iter().for_each(|p| p.add(rates, p.force, p.rub));
        sweep(points, rates, SWEPT);
    } else if T::DIFFERENTIATES {
        let mut plain: Vec<PressurePoint<f64>> = points.iter().map(PressurePoint::value).collect();
        let system = search(&mut plain, rates.iter().map(Rates::value).collect());
        for (p, found) in points.iter_mut().zip(&plain) {
            (p.force, p.slides) = (T::constant(found.force), found.slides);
            p.rub = if found.slides { p.aside * found.rub_share() } else { T::constant(found.rub) };
            p.add(rates, p.force, p.rub);
        }
        system.differentiate(points, &plain, rates);
    } else {
        search(points, Few::from_slice(rates));
        for p in points {
            p.rub = if p.slides { p.aside * p.rub_share() } else { p.rub };
            p.add(rates, p.force, p.rub);
        }
    }
}

/// So many sweeps, or fewer, until no acceleration changes by more than `settled` (m/s^2).
fn sweep<T: Real>(points: &mut [PressurePoint<T>], rates: &mut [Rates<T>], (settled, most): (f64, usize)) {
    for _ in 0..most {
        let moved = points.iter_mut().fold(0.0, |most, p| f64::max(most, p.press(rates)));
        if moved < settled {
            break;
        }
    }
}

/// Gives the points their forces; and the equations that these obey.
fn search<T: Real>(points: &mut [PressurePoint<T>], mut rates: Few<Rates<T>>) -> System {
    for p in points.iter_mut() {
        if p.slides {
            // Its bound is another one than when the last search ended.
            p.rub = p.aside * p.rub_share();
        }
        p.add(&mut rates, p.force, p.rub);
    }
    let mut settled = SETTLING.into_iter();
    loop {
        let system = System::of(points, rates.len());
        if system.improve(points, &mut rates) {
            return system;
        }
        match settled.next() {
            Some(settled) => sweep(points, &mut rates, settled),
            None => return system,
        }
    }
}

/// Linear equations of the forces that are free to be what keeps points closed and surfaces from slipping.
struct System {
    /// Index of the point, and whether it is the friction that is free.
    unknowns: Few<(usize, bool)>,
    /// Acceleration that each equation sees per force, row by row.
    matrix: SmallVec<[f64; 16]>,
}

impl System {
    fn of<T: Real>(points: &[PressurePoint<T>], bodies: usize) -> System {
        let pressing = points.iter().enumerate().filter(|(_, p)| p.force.value() > 0.0);
        let unknowns: Few<(usize, bool)> = pressing
            .flat_map(|(i, p)| std::iter::once((i, false)).chain((!p.slides).then_some((i, true))))
            .collect();
        let n = unknowns.len();
        let mut matrix = SmallVec::from_elem(0.0, n * n);
        let mut rates: Few<Rates<T>> = Few::from_elem(Rates::zero(), bodies);
        let one = T::constant(1.0);
        for (column, &(i, rubs)) in unknowns.iter().enumerate() {
            let p = &points[i];
            rates.fill(Rates::zero());
            let (force, rub) = if rubs { (T::zero(), one) } else { (one, p.rub_per_force()) };
            p.add(&mut rates, force, rub);
            for (row, &(j, rubs)) in unknowns.iter().enumerate() {
                let along = if rubs { points[j].normal.perp() } else { points[j].normal };
                matrix[row * n + column] = points[j].acceleration(&rates, along).value();
            }
        }
        System { unknowns, matrix }
    }

    /// The changes of the forces that the equations ask for, by Gauss and Jordan. Forces that others can replace (two
    /// points of one edge resist one slip) stay.
    fn solve<T: Real>(&self, points: &[PressurePoint<T>], rates: &[Rates<T>]) -> Few<T> {
        let n = self.unknowns.len();
        let mut matrix = self.matrix.clone();
        let wanted = |&(i, rubs): &(usize, bool)| match rubs {
            true => -points[i].slipping(rates),
            false => -points[i].opening(rates),
        };
        let mut right: Few<T> = self.unknowns.iter().map(wanted).collect();
        let mut row_of: Few<Option<usize>> = Few::from_elem(None, n);
        let mut next = 0;
        for column in 0..n {
            let size = |row: &usize| matrix[row * n + column].abs();
            let Some(pivot) = (next..n).max_by(|a, b| size(a).total_cmp(&size(b)).then(b.cmp(a))) else {
                break;
            };
            if size(&pivot) <= REDUNDANT * self.matrix[column * n + column].abs() {
                continue;
            }
            (0..n).for_each(|k| matrix.swap(pivot * n + k, next * n + k));
            right.swap(pivot, next);
            let inverse = 1.0 / matrix[next * n + column];
            for row in (0..n).filter(|&row| row != next) {
                let factor = matrix[row * n + column] * inverse;
                if factor != 0.0 {
                    (column..n).for_each(|k| matrix[row * n + k] -= factor * matrix[next * n + k]);
                    let part = right[next] * factor;
                    right[row] -= part;
                }
            }
            row_of[column] = Some(next);
            next += 1;
        }
        let change = |(column, row): (usize, &Option<usize>)| {
            row.map_or(T::zero(), |row| right[row] * (1.0 / matrix[row * n + column]))
        };
        row_of.iter().enumerate().map(change).collect()
    }

    /// Takes the forces that solve the equations, if the points then still press, slip and open as they do.
    fn improve<T: Real>(&self, points: &mut [PressurePoint<T>], rates: &mut [Rates<T>]) -> bool {
        let change = self.solve(points, rates);
        let mut forces: Few<(T, T)> = points.iter().map(|p| (p.force, p.rub)).collect();
        for (&(i, rubs), &change) in self.unknowns.iter().zip(&change) {
            if rubs {
                forces[i].1 += change;
            } else {
                forces[i].0 += change;
                forces[i].1 += if points[i].slides { points[i].rub_per_force() * change } else { T::zero() };
            }
        }
        let mut better: Few<Rates<T>> = Few::from_slice(rates);
        for (p, &(force, rub)) in points.iter().zip(&forces) {
            p.add(&mut better, force - p.force, rub - p.rub);
        }
        let holds = points.iter().zip(&forces).all(|(p, &(force, rub))| {
            let open = p.force.value() > 0.0 || p.opening(&better).value() >= -SETTLED;
            let (force, rub) = (force.value(), rub.value());
            let rubs = match p.slides {
                true => rub == 0.0 || rub.signum() * p.slipping(&better).value() <= SETTLED,
                false => rub.abs() <= p.aside.value() * force + 1e-9,
            };
            open && force >= 0.0 && rubs
        });
        if holds {
            for (p, (force, rub)) in points.iter_mut().zip(forces) {
                (p.force, p.rub) = (force, rub);
            }
            rates.copy_from_slice(&better);
        }
        holds
    }

    /// Gives the forces their derivatives: the implicit function theorem on the equations.
    fn differentiate<T: Real>(
        &self,
        points: &mut [PressurePoint<T>],
        plain: &[PressurePoint<f64>],
        rates: &mut [Rates<T>],
    ) {
        let change = self.solve(points, rates);
        for (&(i, rubs), change) in self.unknowns.iter().zip(change) {
            let (p, change) = (&mut points[i], change.infinitesimal());
            let (force, rub) = match rubs {
                true => (T::zero(), change),
                false => (change, change * plain[i].rub_per_force()),
            };
            p.force += force;
            p.rub += rub;
            p.add(rates, force, rub);
        }
    }
}

impl<T: Real> PressurePoint<T> {
    /// Normal force with the sign of the friction: times `aside`, the friction of a point that slips (N).
    fn rub_share(&self) -> T {
        self.force * self.direction()
    }

    /// Friction per normal force.
    fn rub_per_force(&self) -> T {
        if self.slides { self.aside * self.direction() } else { T::zero() }
    }

    /// Sign of the friction of a point that slips.
    fn direction(&self) -> f64 {
        // Without friction only its derivative matters, and that goes against the slip.
        let (rub, slip) = (self.rub.value(), self.slip.value());
        if rub != 0.0 { rub.signum() } else { -slip.signum() }
    }

    /// The real parts.
    fn value(&self) -> PressurePoint<f64> {
        PressurePoint {
            contact: self.contact,
            end: self.end,
            sides: self.sides.each_ref().map(|side| side.as_ref().map(Pressed::value)),
            normal: self.normal.value(),
            response: self.response.value(),
            tangential_response: self.tangential_response.value(),
            bias: self.bias.value(),
            slip: self.slip.value(),
            aside: self.aside.value(),
            up: self.up.value(),
            force: self.force.value(),
            rub: self.rub.value(),
            slides: self.slides,
        }
    }
}

impl<T: Real> Pressed<T> {
    /// The real parts.
    fn value(&self) -> Pressed<f64> {
        Pressed {
            at: self.at,
            sign: self.sign,
            arm: self.arm.value(),
            lever: self.lever.value(),
            carried: self.carried.iter().map(|(x, arm)| (*x, arm.value())).collect(),
            compliance: self.compliance.value(),
            inverse_inertia: self.inverse_inertia.value(),
            ball: self.ball,
            rolls: self.rolls,
        }
    }

    pub fn response(&self, direction: Vec2<T>) -> T {
        let turn = self.lever.cross(direction);
        self.compliance + turn * turn * self.inverse_inertia
    }

    /// A force in the plane at the point.
    fn push(&self, rates: &mut [Rates<T>], force: Vec2<T>) {
        let force = force.scaled(self.sign);
        let acceleration = force * self.compliance;
        let turn = self.lever.cross(force) * self.inverse_inertia;
        for &(x, arm) in &self.carried {
            rates[x].velocity += acceleration + arm.perp() * turn;
            rates[x].spin += turn;
        }
        if !self.carried.is_empty() {
            return;
        }
        let r = &mut rates[self.at];
        r.velocity += acceleration;
        r.spin += turn;
        if let (Some(radius), true) = (self.ball, self.rolls) {
            r.roll += acceleration.perp().scaled(1.0 / radius);
        }
    }

    /// A vertical force at a ball's surface turns it; where it rolls, the ground makes a push of it.
    fn lift(&self, r: &mut Rates<T>, n: Vec2<T>, force: T) {
        let Some(radius) = self.ball else { return };
        if self.rolls {
            let acceleration = n * (force * self.compliance);
            r.velocity += acceleration;
            r.roll += acceleration.perp().scaled(1.0 / radius);
        } else {
            r.roll += n.perp() * (force * self.inverse_inertia * radius);
        }
    }
}
