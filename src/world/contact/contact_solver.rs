//! Forces at the points of persistent contacts: a complementarity problem with Coulomb friction, at the level of accelerations.
//!
//! For each point i, with the gap g (m), its stabilised opening acceleration is `a_i = g'' + 2 k g' + k^2 g` (m/s^2) at the rate
//! k = [`STABILISATION_RATE`] (Baumgarte, Computer Methods in Applied Mechanics and Engineering 1 (1972) 1). It is linear in
//! all contact forces. The unknowns are normal forces N_i and tangential forces T_i (N) with
//!
//! - `N_i >= 0`, `a_i >= 0`, `N_i a_i = 0`: a point presses or opens;
//! - `|T_i| <= mu N_i`, with equality where the surfaces slide; otherwise the slip acceleration `s' + 2 k s` is zero.
//!
//! Steps:
//!
//! 1. Start from the forces of the last solution.
//! 2. The points that press, and those that stick, form a linear system ([`ActiveSystem`]). Solve it by Gauss-Jordan elimination,
//!    and accept its solution if all conditions above hold.
//! 3. Otherwise find better sets of points by sweeps of projected Gauss-Seidel (Jourdan, Alart and Jean, Computer Methods in
//!    Applied Mechanics and Engineering 155 (1998) 31), and repeat step 2.
//! 4. Derivatives follow from the linear system by the implicit function theorem; the search looks at real parts only.

use crate::num::{Real, Vec2};
use crate::world::motion::kinematics::{IslandVec, Rates};
use smallvec::SmallVec;

/// Rate at which a persistent contact corrects its gap (1/s).
pub(in crate::world) const STABILISATION_RATE: f64 = 25.0;
/// Rounds of sweeps: change of an acceleration that ends one (m/s^2), and its largest number of sweeps.
const SWEEPS: [(f64, usize); 3] = [(1e-2, 16), (1e-6, 16), (1e-9, 256)];
/// The same for more points than [`MAX_SOLVED`], which are swept only.
const SWEEPS_WITHOUT_SYSTEM: (f64, usize) = (TOLERANCE, 16);
/// An acceleration that counts as zero (m/s^2).
const TOLERANCE: f64 = 1e-6;
/// Largest number of contact points whose linear system is solved.
const MAX_SOLVED: usize = 24;
/// A force is redundant if its pivot is at most this share of its own response.
const REDUNDANCY: f64 = 1e-4;

/// One point of a persistent contact, where a normal force keeps the gap from closing and friction resists the slip.
pub(in crate::world) struct ContactPoint<T> {
    /// Index among the persistent contacts.
    pub contact: usize,
    /// Which end of the edge, where two boxes meet.
    pub end: usize,
    pub sides: [Option<ContactSide<T>>; 2],
    /// Unit normal from a to b.
    pub normal: Vec2<T>,
    /// Relative acceleration per force, along the normal and across (1/kg).
    pub response: T,
    pub tangential_response: T,
    /// Part of the stabilised opening acceleration that comes from gap and velocities (m/s^2).
    pub bias: T,
    /// Velocity of b's surface relative to a's, along `normal.perp()` (m/s).
    pub slip: T,
    /// Largest friction in the plane, and vertical friction on a ball's surface, per normal force.
    pub friction_bound: T,
    pub vertical_friction: T,
    /// On b (N).
    pub normal_force: T,
    pub tangential_force: T,
    /// Whether friction is at its bound.
    pub slides: bool,
}

/// Response of one body to a force at a contact point.
pub(in crate::world) struct ContactSide<T> {
    /// Position of the body in the island.
    pub at: usize,
    /// Forces are given as they act on b: -1 for a, 1 for b.
    pub sign: f64,
    /// From the body's centre to the point (m).
    pub arm: Vec2<T>,
    /// From the centre of the body's cluster to the point (m).
    pub cluster_arm: Vec2<T>,
    /// Positions in the island of all bodies of the cluster, and their places from its centre (m); empty without cluster.
    pub carried: Vec<(usize, Vec2<T>)>,
    /// Acceleration of the centre per force (1/kg), and angular acceleration per torque (1/(kg m^2)).
    pub compliance: T,
    pub inverse_inertia: T,
    /// Radius of a ball (m).
    pub ball: Option<f64>,
    pub rolls: bool,
}

impl<T: Real> ContactPoint<T> {
    /// One step of projected Gauss-Seidel: the normal force that keeps the gap closed, at least zero, and the friction that
    /// ends the slip, within Coulomb's bound. Returns the largest change of an acceleration (m/s^2).
    fn relax(&mut self, rates: &mut [Rates<T>]) -> f64 {
        let opening = self.opening(rates);
        let total = (self.normal_force - opening / self.response).max(T::zero());
        let more = total - self.normal_force;
        self.normal_force = total;
        self.add_forces(rates, more, T::zero());
        let pressed = (more * self.response).value().abs();
        if self.friction_bound.value() == 0.0 && !T::DIFFERENTIATES {
            self.slides = true;
            return pressed;
        }
        let slip_acceleration = self.slip_acceleration(rates);
        let most = self.friction_bound * self.normal_force;
        let free = self.tangential_force - slip_acceleration / self.tangential_response;
        self.slides = free.value().abs() >= most.value();
        let total = free.max(-most).min(most);
        let more = total - self.tangential_force;
        self.tangential_force = total;
        self.add_forces(rates, T::zero(), more);
        pressed.max((more * self.tangential_response).value().abs())
    }

    /// Stabilised opening acceleration of the gap (m/s^2): zero at a point that presses.
    fn opening(&self, rates: &[Rates<T>]) -> T {
        self.bias + self.acceleration(rates, self.normal)
    }

    /// Stabilised acceleration of the slip (m/s^2): zero at a point that sticks.
    fn slip_acceleration(&self, rates: &[Rates<T>]) -> T {
        self.slip * (2.0 * STABILISATION_RATE) + self.acceleration(rates, self.normal.perp())
    }

    /// Adds to the accelerations what a normal and a tangential force (N) cause.
    fn add_forces(&self, rates: &mut [Rates<T>], normal: T, tangential: T) {
        let push = self.normal * normal + self.normal.perp() * tangential;
        for s in self.sides.iter().flatten() {
            s.push(rates, push);
            s.lift(&mut rates[s.at], self.normal, self.vertical_friction * normal);
        }
    }

    /// Relative acceleration of the surfaces along a direction (m/s^2).
    fn acceleration(&self, rates: &[Rates<T>], along: Vec2<T>) -> T {
        self.sides.iter().flatten().fold(T::zero(), |sum, s| {
            let r = &rates[s.at];
            sum + along.dot(r.velocity + s.arm.perp() * r.spin) * s.sign
        })
    }

    /// Friction of a point that slides, divided by `friction_bound`: the normal force with the sign of the friction (N).
    fn signed_normal_force(&self) -> T {
        self.normal_force * self.direction()
    }

    /// Friction per normal force; zero at a point that sticks.
    fn friction_per_force(&self) -> T {
        if self.slides { self.friction_bound * self.direction() } else { T::zero() }
    }

    /// Sign of the friction of a point that slides.
    fn direction(&self) -> f64 {
        // Without friction only its derivative matters, and that opposes the slip.
        let (friction, slip) = (self.tangential_force.value(), self.slip.value());
        if friction != 0.0 { friction.signum() } else { -slip.signum() }
    }

    /// Force on b (N).
    pub fn force(&self) -> Vec2<T> {
        self.normal * self.normal_force + self.normal.perp() * self.tangential_force
    }

    /// The real parts.
    fn value(&self) -> ContactPoint<f64> {
        ContactPoint {
            contact: self.contact,
            end: self.end,
            sides: self.sides.each_ref().map(|side| side.as_ref().map(ContactSide::value)),
            normal: self.normal.value(),
            response: self.response.value(),
            tangential_response: self.tangential_response.value(),
            bias: self.bias.value(),
            slip: self.slip.value(),
            friction_bound: self.friction_bound.value(),
            vertical_friction: self.vertical_friction.value(),
            normal_force: self.normal_force.value(),
            tangential_force: self.tangential_force.value(),
            slides: self.slides,
        }
    }
}

/// Solves for the forces of the points, from those that they have, and adds their effect to the accelerations.
pub(in crate::world) fn solve_contacts<T: Real>(points: &mut [ContactPoint<T>], rates: &mut [Rates<T>]) {
    if points.len() > MAX_SOLVED {
        points.iter().for_each(|p| p.add_forces(rates, p.normal_force, p.tangential_force));
        sweep(points, rates, SWEEPS_WITHOUT_SYSTEM);
    } else if T::DIFFERENTIATES {
        let mut plain: Vec<ContactPoint<f64>> = points.iter().map(ContactPoint::value).collect();
        let system = search(&mut plain, rates.iter().map(Rates::value).collect());
        for (p, found) in points.iter_mut().zip(&plain) {
            (p.normal_force, p.slides) = (T::constant(found.normal_force), found.slides);
            p.tangential_force = if found.slides {
                p.friction_bound * found.signed_normal_force()
            } else {
                T::constant(found.tangential_force)
            };
            p.add_forces(rates, p.normal_force, p.tangential_force);
        }
        system.differentiate(points, &plain, rates);
    } else {
        search(points, IslandVec::from_slice(rates));
        for p in points {
            p.tangential_force =
                if p.slides { p.friction_bound * p.signed_normal_force() } else { p.tangential_force };
            p.add_forces(rates, p.normal_force, p.tangential_force);
        }
    }
}

/// At most `most` sweeps, until no acceleration changes by more than `tolerance` (m/s^2).
fn sweep<T: Real>(points: &mut [ContactPoint<T>], rates: &mut [Rates<T>], (tolerance, most): (f64, usize)) {
    for _ in 0..most {
        let moved = points.iter_mut().fold(0.0, |most, p| f64::max(most, p.relax(rates)));
        if moved < tolerance {
            break;
        }
    }
}

/// Finds the forces of the points, and the linear system that they solve.
fn search<T: Real>(points: &mut [ContactPoint<T>], mut rates: IslandVec<Rates<T>>) -> ActiveSystem {
    for p in points.iter_mut() {
        if p.slides {
            // The bound may differ from that of the last solution.
            p.tangential_force = p.friction_bound * p.signed_normal_force();
        }
        p.add_forces(&mut rates, p.normal_force, p.tangential_force);
    }
    let mut sweeps = SWEEPS.into_iter();
    loop {
        let system = ActiveSystem::of(points, rates.len());
        if system.improve(points, &mut rates) {
            return system;
        }
        match sweeps.next() {
            Some(limits) => sweep(points, &mut rates, limits),
            None => return system,
        }
    }
}

/// Linear equations of the free forces: normal forces of points that press, tangential forces of points that stick.
struct ActiveSystem {
    /// Index of the point, and whether the unknown is its tangential force.
    unknowns: IslandVec<(usize, bool)>,
    /// Acceleration of each equation per unit force, row by row (1/kg).
    matrix: SmallVec<[f64; 16]>,
}

impl ActiveSystem {
    fn of<T: Real>(points: &[ContactPoint<T>], bodies: usize) -> ActiveSystem {
        let pressing = points.iter().enumerate().filter(|(_, p)| p.normal_force.value() > 0.0);
        let unknowns: IslandVec<(usize, bool)> = pressing
            .flat_map(|(i, p)| std::iter::once((i, false)).chain((!p.slides).then_some((i, true))))
            .collect();
        let n = unknowns.len();
        let mut matrix = SmallVec::from_elem(0.0, n * n);
        let mut rates: IslandVec<Rates<T>> = IslandVec::from_elem(Rates::zero(), bodies);
        let one = T::constant(1.0);
        for (column, &(i, is_tangential)) in unknowns.iter().enumerate() {
            let p = &points[i];
            rates.fill(Rates::zero());
            let (normal, tangential) =
                if is_tangential { (T::zero(), one) } else { (one, p.friction_per_force()) };
            p.add_forces(&mut rates, normal, tangential);
            for (row, &(j, is_tangential)) in unknowns.iter().enumerate() {
                let along = if is_tangential { points[j].normal.perp() } else { points[j].normal };
                matrix[row * n + column] = points[j].acceleration(&rates, along).value();
            }
        }
        ActiveSystem { unknowns, matrix }
    }

    /// Changes of the forces that solve the equations, by Gauss-Jordan elimination. Redundant forces stay: two points of one
    /// edge resist one slip.
    fn solve<T: Real>(&self, points: &[ContactPoint<T>], rates: &[Rates<T>]) -> IslandVec<T> {
        let n = self.unknowns.len();
        let mut matrix = self.matrix.clone();
        let wanted = |&(i, is_tangential): &(usize, bool)| match is_tangential {
            true => -points[i].slip_acceleration(rates),
            false => -points[i].opening(rates),
        };
        let mut right: IslandVec<T> = self.unknowns.iter().map(wanted).collect();
        let mut row_of: IslandVec<Option<usize>> = IslandVec::from_elem(None, n);
        let mut next = 0;
        for column in 0..n {
            let size = |row: &usize| matrix[row * n + column].abs();
            let Some(pivot) = (next..n).max_by(|a, b| size(a).total_cmp(&size(b)).then(b.cmp(a))) else {
                break;
            };
            if size(&pivot) <= REDUNDANCY * self.matrix[column * n + column].abs() {
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

    /// Takes the forces that solve the equations if they satisfy the conditions of all points; whether they do.
    fn improve<T: Real>(&self, points: &mut [ContactPoint<T>], rates: &mut [Rates<T>]) -> bool {
        let change = self.solve(points, rates);
        let mut forces: IslandVec<(T, T)> =
            points.iter().map(|p| (p.normal_force, p.tangential_force)).collect();
        for (&(i, is_tangential), &change) in self.unknowns.iter().zip(&change) {
            if is_tangential {
                forces[i].1 += change;
            } else {
                forces[i].0 += change;
                forces[i].1 +=
                    if points[i].slides { points[i].friction_per_force() * change } else { T::zero() };
            }
        }
        let mut better: IslandVec<Rates<T>> = IslandVec::from_slice(rates);
        for (p, &(normal, tangential)) in points.iter().zip(&forces) {
            p.add_forces(&mut better, normal - p.normal_force, tangential - p.tangential_force);
        }
        let holds = points.iter().zip(&forces).all(|(p, &(normal, tangential))| {
            let open = p.normal_force.value() > 0.0 || p.opening(&better).value() >= -TOLERANCE;
            let (normal, tangential) = (normal.value(), tangential.value());
            let is_coulomb = match p.slides {
                true => {
                    tangential == 0.0
                        || tangential.signum() * p.slip_acceleration(&better).value() <= TOLERANCE
                }
                false => tangential.abs() <= p.friction_bound.value() * normal + 1e-9,
            };
            open && normal >= 0.0 && is_coulomb
        });
        if holds {
            for (p, (normal, tangential)) in points.iter_mut().zip(forces) {
                (p.normal_force, p.tangential_force) = (normal, tangential);
            }
            rates.copy_from_slice(&better);
        }
        holds
    }

    /// Gives the forces their derivatives, by the implicit function theorem on the equations.
    fn differentiate<T: Real>(
        &self,
        points: &mut [ContactPoint<T>],
        plain: &[ContactPoint<f64>],
        rates: &mut [Rates<T>],
    ) {
        let change = self.solve(points, rates);
        for (&(i, is_tangential), change) in self.unknowns.iter().zip(change) {
            let (p, change) = (&mut points[i], change.infinitesimal());
            let (normal, tangential) = match is_tangential {
                true => (T::zero(), change),
                false => (change, change * plain[i].friction_per_force()),
            };
            p.normal_force += normal;
            p.tangential_force += tangential;
            p.add_forces(rates, normal, tangential);
        }
    }
}

impl<T: Real> ContactSide<T> {
    /// The real parts.
    fn value(&self) -> ContactSide<f64> {
        ContactSide {
            at: self.at,
            sign: self.sign,
            arm: self.arm.value(),
            cluster_arm: self.cluster_arm.value(),
            carried: self.carried.iter().map(|(x, arm)| (*x, arm.value())).collect(),
            compliance: self.compliance.value(),
            inverse_inertia: self.inverse_inertia.value(),
            ball: self.ball,
            rolls: self.rolls,
        }
    }

    /// Acceleration of the point per force along a direction (1/kg).
    pub fn response(&self, direction: Vec2<T>) -> T {
        let turn = self.cluster_arm.cross(direction);
        self.compliance + turn * turn * self.inverse_inertia
    }

    /// Adds the effect of a force in the plane at the point (N).
    fn push(&self, rates: &mut [Rates<T>], force: Vec2<T>) {
        let force = force.scaled(self.sign);
        let acceleration = force * self.compliance;
        let turn = self.cluster_arm.cross(force) * self.inverse_inertia;
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

    /// Adds the effect of a vertical force at a ball's surface (N). It changes the roll; if the ball rolls, friction with the
    /// ground turns that into an acceleration.
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
