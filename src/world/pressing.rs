//! Contacts that last: bodies that press on each other move together until they part.

use super::geometry::{Feature, Pose, Proximity, manifold};
use super::impact::{Side, facing, point_velocity};
use super::motion::{Kinematics, Mode, Rates};
use super::rigid::in_group;
use super::simulate::{Few, Run};
use crate::body::Wrench;
use crate::effects::Scalar;
use crate::num::{Real, Vec2};
use crate::scene::Shape;
use smallvec::SmallVec;

/// Rate at which a kept contact corrects its gap (1/s).
const STIFFNESS: f64 = 25.0;
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

/// A contact that lasts: bodies `a` and `b` (or wall `b - bodies`) press on each other.
#[derive(Clone, Copy)]
pub(super) struct Touching<T> {
    pub a: usize,
    pub b: usize,
    pub pressing: bool,
    /// Coulomb coefficient between the two.
    pub friction: T,
    /// Normal and tangential force at either end (N), as last found: where the next search begins.
    forces: [(f64, f64); 2],
    /// Whether friction was at its bound there.
    slides: [bool; 2],
}

impl<T: Real> Touching<T> {
    pub fn new(a: usize, b: usize, friction: T) -> Self {
        Touching { a, b, pressing: true, friction, forces: [(0.0, 0.0); 2], slides: [true; 2] }
    }
}

impl<T: Scalar> Run<'_, T> {
    /// Bodies joined by kept contacts or pair forces move as one group; released contacts are forgotten.
    pub(super) fn regroup(&mut self) {
        self.touching.retain(|t| t.pressing);
        self.leave_obstacles();
        for i in 0..self.bodies.len() {
            self.bodies[i].group.clear();
            self.bodies[i].group.push(i);
        }
        if self.laws.has_pair_forces() {
            let all: Vec<usize> =
                (0..self.bodies.len()).filter(|&i| self.bodies[i].mode != Mode::Absent).collect();
            for &i in &all {
                self.bodies[i].group.clone_from(&all);
            }
            return;
        }
        for k in 0..self.touching.len() {
            let Touching { a, b, .. } = self.touching[k];
            self.join(a, b);
        }
        self.join_bonds();
    }

    /// A body that has come out of an obstacle may run into it again.
    fn leave_obstacles(&mut self) {
        let inside = |&(a, b): &(usize, usize)| {
            let (near, rate) =
                facing(&self.bodies[a].from, self.shape(a), &self.kinematics(b), self.shape(b));
            near.gap.value() <= 0.0 || rate.value() < 0.0
        };
        let passing = self.passing.iter().copied().filter(inside).collect();
        self.passing = passing;
    }

    pub(super) fn join(&mut self, a: usize, b: usize) {
        if b >= self.bodies.len() || self.bodies[a].group.contains(&b) {
            return;
        }
        let mut all = [self.bodies[a].group.as_slice(), self.bodies[b].group.as_slice()].concat();
        all.sort_unstable();
        for &i in &all {
            self.bodies[i].group.clone_from(&all);
        }
    }

    /// Splits a group whose contacts no longer press.
    pub(super) fn release(&mut self, group: &[usize]) {
        let pressing = |t: &Touching<T>| t.pressing || !group.contains(&t.a);
        if self.touching.iter().all(pressing) {
            return;
        }
        self.touching.retain(pressing);
        self.split(group);
    }

    /// Groups anew the bodies of a group whose contacts have changed.
    pub(super) fn split(&mut self, group: &[usize]) {
        if self.laws.has_pair_forces() {
            return;
        }
        for &j in group {
            self.bodies[j].group = vec![j];
        }
        for k in 0..self.touching.len() {
            let Touching { a, b, .. } = self.touching[k];
            self.join(a, b);
        }
        self.join_bonds();
    }

    /// Accelerations of a group, kept contacts included; `mark` notes which of those still press.
    pub(super) fn rates(
        &mut self,
        group: &[usize],
        k: &[Kinematics<T>],
        w: &[Wrench<T>],
        mark: bool,
    ) -> Few<Rates<T>> {
        let mut rates = self.free_rates(group, k, w);
        self.fuse(group, k, &mut rates);
        if !self.touching.iter().any(|t| group.contains(&t.a)) {
            return rates;
        }
        let points = self.solved(group, k, &mut rates);
        if mark {
            for c in 0..self.touching.len() {
                if group.contains(&self.touching[c].a) {
                    self.touching[c].pressing =
                        points.iter().any(|p| p.contact == c && p.force.value() > 0.0);
                }
            }
        }
        rates
    }

    /// Accelerations of a group that nothing joins.
    pub(super) fn free_rates(&self, group: &[usize], k: &[Kinematics<T>], w: &[Wrench<T>]) -> Few<Rates<T>> {
        let free = |(x, &j): (usize, &usize)| self.laws.rates(j, &k[x], self.bodies[j].mode, &w[x]);
        group.iter().enumerate().map(free).collect()
    }

    /// The pressure points of the group with their forces; `rates` take them in. The search starts where the last
    /// one ended and looks at real parts only: derivatives follow from the equations of the points that press.
    pub(super) fn solved(
        &mut self,
        group: &[usize],
        k: &[Kinematics<T>],
        rates: &mut [Rates<T>],
    ) -> Vec<PressurePoint<T>> {
        let mut points = self.pressure_points(group, k);
        if points.len() > MOST_SOLVED {
            points.iter().for_each(|p| p.add(rates, p.force, p.rub));
            sweep(&mut points, rates, SWEPT);
        } else {
            let (plain, system) = search(&points, rates);
            for (p, found) in points.iter_mut().zip(&plain) {
                (p.force, p.slides) = (T::constant(found.force), found.slides);
                p.rub = if found.slides { p.aside * found.rub_share() } else { T::constant(found.rub) };
                p.add(rates, p.force, p.rub);
            }
            if T::DIFFERENTIATES {
                system.differentiate(&mut points, &plain, rates);
            }
        }
        for p in &points {
            let kept = &mut self.touching[p.contact];
            (kept.forces[p.end], kept.slides[p.end]) = ((p.force.value(), p.rub.value()), p.slides);
        }
        points
    }

    /// Bodies that friction is about to stop come to rest at once: so slow, and pressed on, their motion would be
    /// all jitter. Whether any did.
    pub(super) fn settle(
        &mut self,
        group: &[usize],
        k: &mut [Kinematics<T>],
        w: &[Wrench<T>],
        rates: &[Rates<T>],
    ) -> bool {
        let mut settled = false;
        for (x, &j) in group.iter().enumerate() {
            let moves = matches!(self.bodies[j].mode, Mode::Slide | Mode::Roll);
            let left = match self.cluster(j) {
                Some(_) => self.cluster_settles(j, group, k, rates),
                None => self.laws.time_to_settle(j, &k[x], &rates[x]),
            };
            if let Some(left) = left.filter(|_| moves && self.held(j, group, k, w)) {
                // The way that is left.
                for i in self.stuck_to(j) {
                    let from = &mut self.bodies[i].from;
                    from.position += from.velocity * (left * 0.5);
                    from.yaw += from.spin * left * 0.5;
                }
                self.stop(j, self.bodies[j].since.value());
                settled = true;
            }
        }
        if settled {
            group.iter().zip(k).for_each(|(&j, k)| *k = self.bodies[j].from);
        }
        settled
    }

    /// Body `i`, and what sticks to it, stops.
    pub(super) fn stop(&mut self, i: usize, time: f64) {
        for j in self.stuck_to(i) {
            self.rest(j);
            self.note_stop(j, time);
        }
    }

    /// Predicts each group among these bodies.
    pub(super) fn predict_all(&mut self, bodies: &[usize]) {
        for &j in bodies {
            if self.bodies[j].group[0] == j {
                self.predict(j);
            }
        }
    }

    /// Bodies at rest that are pressed harder than friction can hold begin to slide; whether any did.
    pub(super) fn wake(&mut self, group: &[usize], k: &[Kinematics<T>], w: &[Wrench<T>]) -> bool {
        let still = |run: &Self, j: usize| run.bodies[j].mode == Mode::Rest;
        if self.touching.is_empty() || !group.iter().any(|&j| still(self, j)) {
            return false;
        }
        let mut rates = self.free_rates(group, k, w);
        self.fuse(group, k, &mut rates);
        let points = self.solved(group, k, &mut rates);
        let mut pressed: Few<Wrench<T>> = w.into();
        for p in &points {
            let force = p.normal * p.force + p.normal.perp() * p.rub;
            for s in p.sides.iter().flatten() {
                pressed[s.at].force += force.scaled(s.sign);
            }
        }
        let mut woken = false;
        for &j in group {
            if still(self, j) && !self.held(j, group, k, &pressed) {
                for i in self.stuck_to(j) {
                    self.bodies[i].mode = Mode::Slide;
                }
                woken = true;
            }
        }
        woken
    }

    /// The points at which kept contacts of the group press.
    fn pressure_points(&self, group: &[usize], k: &[Kinematics<T>]) -> Vec<PressurePoint<T>> {
        let mut points = vec![];
        for (contact, &Touching { a, b, friction, forces, slides, .. }) in self.touching.iter().enumerate() {
            let place = |body: usize| group.iter().position(|&j| j == body);
            let Some(x) = place(a) else { continue };
            let y = place(b);
            let (ka, kb) = (&k[x], y.map_or_else(|| self.kinematics(b), |y| k[y]));
            let (sa, sb) = (self.shape(a), self.shape(b));
            let ends = manifold(&Pose::of(ka, sa), sa, &Pose::of(&kb, sb), sb);
            for (end, near) in ends.into_iter().enumerate() {
                let Some(near) = near else { continue };
                let near = self.grown(near, (a, ka), (b, &kb));
                let point = (near.on_a + near.on_b).scaled(0.5);
                let slip = point_velocity(&kb, near.on_b) - point_velocity(ka, near.on_a);
                let n = near.normal;
                let pressed = |at, body, sign| self.pressed((group, k), (at, body), sign, point);
                let sides = [Some(pressed(x, a, -1.0)), y.map(|y| pressed(y, b, 1.0))];
                let response = |d| sides.iter().flatten().fold(T::zero(), |sum, s| sum + s.response(d));
                let (response, tangential_response) = (response(n), response(n.perp()));
                let bias = curvature(&near, ka, sa, &kb, sb)
                    + n.dot(slip) * (2.0 * STIFFNESS)
                    + near.gap * (STIFFNESS * STIFFNESS);
                let lift = -(lift_of(ka, sa, n) + lift_of(&kb, sb, n));
                let slip = n.perp().dot(slip);
                let speed = (slip * slip + lift * lift).sqrt_or_zero();
                // A rolling ball rubs up or down, hardly aside.
                let (aside, up) = match speed.value() > 0.0 {
                    true => (friction * slip.abs() / speed, -(friction * lift / speed)),
                    false => (friction, T::zero()),
                };
                if response.value() > 0.0 {
                    let (force, rub) = forces[end];
                    points.push(PressurePoint {
                        contact,
                        end,
                        sides,
                        normal: n,
                        response,
                        bias,
                        force: T::constant(force),
                        tangential_response,
                        slip,
                        aside,
                        up,
                        rub: T::constant(rub),
                        slides: slides[end],
                    });
                }
            }
        }
        points
    }

    /// The narrowest gap among kept contacts of the group at these states (m).
    pub(super) fn narrowest(&self, group: &[usize], k: &[Kinematics<T>]) -> f64 {
        let gap = |t: &Touching<T>| {
            let place = |body: usize| group.iter().position(|&j| j == body);
            let ka = k[place(t.a)?].value();
            let kb = place(t.b).map_or_else(|| self.kinematics(t.b).value(), |y| k[y].value());
            Some(facing(&ka, self.shape(t.a), &kb, self.shape(t.b)).0.gap)
        };
        self.touching.iter().filter_map(gap).fold(f64::INFINITY, f64::min)
    }

    /// How `body`, at place `at` of the group, answers a force at `point`.
    fn pressed(
        &self,
        (group, k): (&[usize], &[Kinematics<T>]),
        (at, body): (usize, usize),
        sign: f64,
        point: Vec2<T>,
    ) -> Pressed<T> {
        let mode = self.bodies[body].mode;
        let moves = matches!(mode, Mode::Slide | Mode::Roll);
        let arm = point - k[at].position;
        if let Some(rigid) = self.rigid(body, |j| in_group(group, k, j)).filter(|_| moves) {
            let center = rigid.kinematics.position;
            let place = |j: &usize| group.iter().position(|i| i == j);
            let places = self.cluster(body).into_iter().flatten().filter_map(place);
            let Side { inverse_mass: compliance, inverse_inertia, .. } = rigid.side();
            return Pressed {
                at,
                sign,
                arm,
                lever: point - center,
                compliance,
                inverse_inertia,
                carried: places.map(|x| (x, k[x].position - center)).collect(),
                ball: None,
                rolls: false,
            };
        }
        let inverse_inertia = if moves { self.laws.inverse_inertia[body] } else { T::zero() };
        let shape = &self.laws.shapes[body];
        let ball = shape.is_ball().then(|| shape.bounding_radius());
        let rolls = mode == Mode::Roll;
        let compliance = self.laws.compliance(body, mode);
        Pressed { at, sign, arm, lever: arm, compliance, inverse_inertia, carried: vec![], ball, rolls }
    }
}

/// Speed at which the surface of a ball moves up where it is touched in direction `n` (m/s).
fn lift_of<T: Real>(k: &Kinematics<T>, shape: &Shape, n: Vec2<T>) -> T {
    if shape.is_ball() { k.roll.cross(n) * shape.bounding_radius() } else { T::zero() }
}

/// One point of a kept contact, where a normal force keeps the gap from closing and friction resists the slip.
pub(super) struct PressurePoint<T> {
    /// Index among the touching pairs.
    contact: usize,
    /// Which end of the edge, where box meets box.
    end: usize,
    pub sides: [Option<Pressed<T>>; 2],
    /// Unit normal from a to b.
    pub normal: Vec2<T>,
    /// Acceleration per force, along the normal and across (1/kg).
    response: T,
    tangential_response: T,
    /// Opening acceleration that comes from the velocities, and the correction of the gap (m/s^2).
    bias: T,
    /// Velocity of b's surface past a's, along `normal.perp()` (m/s).
    slip: T,
    /// Most friction in the plane, and friction upwards on a ball's surface, as shares of the normal force.
    aside: T,
    up: T,
    /// Normal force and tangential force on b (N).
    pub force: T,
    pub rub: T,
    /// Whether friction is at its bound.
    slides: bool,
}

/// How one body answers a force at a pressure point.
pub(super) struct Pressed<T> {
    /// Index in the group.
    pub at: usize,
    /// Forces are given as they act on b: -1 for a, 1 for b.
    pub sign: f64,
    /// From its centre to the point, and from the centre that it has with what sticks to it (m).
    arm: Vec2<T>,
    lever: Vec2<T>,
    /// Places in the group of all that stick together, and where they are from their centre (m); empty for one alone.
    carried: Vec<(usize, Vec2<T>)>,
    /// Acceleration of the centre per force, and of the spin per torque.
    compliance: T,
    inverse_inertia: T,
    /// Radius of a ball, and whether it rolls.
    ball: Option<f64>,
    rolls: bool,
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

/// So many sweeps, or fewer, until no acceleration changes by more than `settled` (m/s^2).
fn sweep<T: Real>(points: &mut [PressurePoint<T>], rates: &mut [Rates<T>], (settled, most): (f64, usize)) {
    for _ in 0..most {
        let moved = points.iter_mut().fold(0.0, |most, p| f64::max(most, p.press(rates)));
        if moved < settled {
            break;
        }
    }
}

/// The points without derivatives and with their forces, and the equations that these obey.
fn search<T: Real>(points: &[PressurePoint<T>], rates: &[Rates<T>]) -> (Vec<PressurePoint<f64>>, System) {
    let mut plain: Vec<PressurePoint<f64>> = points.iter().map(PressurePoint::value).collect();
    let mut rates: Few<Rates<f64>> = rates.iter().map(Rates::value).collect();
    for p in &mut plain {
        if p.slides {
            // Its bound is another one than when the last search ended.
            p.rub = p.aside * p.rub_share();
        }
        p.add(&mut rates, p.force, p.rub);
    }
    let mut settled = SETTLING.into_iter();
    loop {
        let system = System::of(&plain, rates.len());
        if system.improve(&mut plain, &mut rates) {
            return (plain, system);
        }
        match settled.next() {
            Some(settled) => sweep(&mut plain, &mut rates, settled),
            None => return (plain, system),
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
    fn of(points: &[PressurePoint<f64>], bodies: usize) -> System {
        let pressing = points.iter().enumerate().filter(|(_, p)| p.force > 0.0);
        let unknowns: Few<(usize, bool)> = pressing
            .flat_map(|(i, p)| std::iter::once((i, false)).chain((!p.slides).then_some((i, true))))
            .collect();
        let n = unknowns.len();
        let mut matrix = SmallVec::from_elem(0.0, n * n);
        for (column, &(i, rubs)) in unknowns.iter().enumerate() {
            let p = &points[i];
            let mut rates: Few<Rates<f64>> = Few::from_elem(Rates::zero(), bodies);
            p.add(&mut rates, if rubs { 0.0 } else { 1.0 }, if rubs { 1.0 } else { p.rub_per_force() });
            for (row, &(j, rubs)) in unknowns.iter().enumerate() {
                let along = if rubs { points[j].normal.perp() } else { points[j].normal };
                matrix[row * n + column] = points[j].acceleration(&rates, along);
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
    fn improve(&self, points: &mut [PressurePoint<f64>], rates: &mut [Rates<f64>]) -> bool {
        let change = self.solve(points, rates);
        let mut forces: Few<(f64, f64)> = points.iter().map(|p| (p.force, p.rub)).collect();
        for (&(i, rubs), change) in self.unknowns.iter().zip(&change) {
            if rubs {
                forces[i].1 += change;
            } else {
                forces[i].0 += change;
                forces[i].1 += if points[i].slides { points[i].rub_per_force() * change } else { 0.0 };
            }
        }
        let mut better: Few<Rates<f64>> = Few::from_slice(rates);
        for (p, &(force, rub)) in points.iter().zip(&forces) {
            p.add(&mut better, force - p.force, rub - p.rub);
        }
        let holds = points.iter().zip(&forces).all(|(p, &(force, rub))| {
            let open = p.force > 0.0 || p.opening(&better) >= -SETTLED;
            let rubs = match p.slides {
                true => rub == 0.0 || rub.signum() * p.slipping(&better) <= SETTLED,
                false => rub.abs() <= p.aside * force + 1e-9,
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

impl PressurePoint<f64> {
    /// Normal force with the sign of the friction: times `aside`, the friction of a point that slips (N).
    fn rub_share(&self) -> f64 {
        self.force * self.direction()
    }

    /// Friction per normal force.
    fn rub_per_force(&self) -> f64 {
        if self.slides { self.aside * self.direction() } else { 0.0 }
    }

    /// Sign of the friction of a point that slips.
    fn direction(&self) -> f64 {
        // Without friction only its derivative matters, and that goes against the slip.
        if self.rub != 0.0 { self.rub.signum() } else { -self.slip.signum() }
    }
}

impl<T: Real> PressurePoint<T> {
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

    fn response(&self, direction: Vec2<T>) -> T {
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

/// Second derivative of the gap that comes from the velocities alone (m/s^2). A circle takes part with its
/// centre, a box with the corner or the face that touches.
fn curvature<T: Real>(
    near: &Proximity<T>,
    a: &Kinematics<T>,
    sa: &Shape,
    b: &Kinematics<T>,
    sb: &Shape,
) -> T {
    let point = |k: &Kinematics<T>, s: &Shape, on: Vec2<T>| if s.is_round() { k.position } else { on };
    let (pa, pb) = (point(a, sa, near.on_a), point(b, sb, near.on_b));
    let (va, vb) = (point_velocity(a, pa), point_velocity(b, pb));
    let n = near.normal;
    let centripetal = |k: &Kinematics<T>, p: Vec2<T>, n: Vec2<T>| -(n.dot(p - k.position) * k.spin * k.spin);
    let face = |host: &Kinematics<T>, guest: &Kinematics<T>, n: Vec2<T>, p: Vec2<T>, v: Vec2<T>| {
        let w = host.spin;
        centripetal(guest, p, n) + w * n.perp().dot(v - host.velocity) * 2.0
            - w * w * n.dot(p - host.position)
    };
    match near.feature {
        Feature::FaceOfA => face(a, b, n, pb, vb),
        Feature::FaceOfB => face(b, a, -n, pa, va),
        Feature::Points => {
            let across = n.perp().dot(vb - va);
            let span = (pb - pa).norm();
            let swing = if span.value() > 0.0 { across * across / span } else { T::zero() };
            swing + centripetal(b, pb, n) - centripetal(a, pa, n)
        }
    }
}
