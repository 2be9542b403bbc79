//! Contacts that last: bodies that press on each other move together until they part.

use super::geometry::{Feature, Pose, Proximity, manifold};
use super::impact::{facing, point_velocity};
use super::motion::{Kinematics, Mode, Rates};
use super::simulate::{Few, Run};
use crate::body::Wrench;
use crate::effects::Scalar;
use crate::num::{Real, Vec2};
use crate::scene::Shape;

/// Rate at which a kept contact corrects its gap (1/s).
const STIFFNESS: f64 = 25.0;
/// Sweeps over simultaneous pressure points.
const SWEEPS: usize = 16;

/// A contact that lasts: bodies `a` and `b` (or wall `b - bodies`) press on each other.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Touching {
    pub a: usize,
    pub b: usize,
    pub pressing: bool,
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
        let pressing = |t: &Touching| t.pressing || !group.contains(&t.a);
        if self.touching.iter().all(pressing) {
            return;
        }
        self.touching.retain(pressing);
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
    }

    /// Accelerations of a group, kept contacts included; `mark` notes which of those still press.
    pub(super) fn rates(
        &mut self,
        group: &[usize],
        k: &[Kinematics<T>],
        w: &[Wrench<T>],
        mark: bool,
    ) -> Few<Rates<T>> {
        let free = |(x, &j): (usize, &usize)| self.laws.rates(j, &k[x], self.bodies[j].mode, &w[x]);
        let mut rates: Few<Rates<T>> = group.iter().enumerate().map(free).collect();
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

    /// The pressure points of the group with their forces; `rates` take them in.
    fn solved(&self, group: &[usize], k: &[Kinematics<T>], rates: &mut [Rates<T>]) -> Vec<PressurePoint<T>> {
        let mut points = self.pressure_points(group, k);
        let sweeps = if points.len() == 1 { 1 } else { SWEEPS };
        for _ in 0..sweeps {
            for p in &mut points {
                p.press(rates);
            }
        }
        points
    }

    /// Bodies at rest that are pressed harder than friction can hold begin to slide; whether any did.
    pub(super) fn wake(&mut self, group: &[usize], k: &[Kinematics<T>], w: &[Wrench<T>]) -> bool {
        let still = |run: &Self, j: usize| run.bodies[j].mode == Mode::Rest;
        if self.touching.is_empty() || !group.iter().any(|&j| still(self, j)) {
            return false;
        }
        let free = |(x, &j): (usize, &usize)| self.laws.rates(j, &k[x], self.bodies[j].mode, &w[x]);
        let mut rates: Few<Rates<T>> = group.iter().enumerate().map(free).collect();
        let points = self.solved(group, k, &mut rates);
        let mut woken = false;
        for (x, &j) in group.iter().enumerate() {
            if !still(self, j) {
                continue;
            }
            let mut pressed = w[x];
            for p in &points {
                for s in p.sides.iter().flatten().filter(|s| s.at == x) {
                    pressed.force += s.direction * p.force;
                }
            }
            if !self.laws.holds(j, &pressed) {
                self.bodies[j].mode = Mode::Slide;
                woken = true;
            }
        }
        woken
    }

    /// The points at which kept contacts of the group press.
    fn pressure_points(&self, group: &[usize], k: &[Kinematics<T>]) -> Vec<PressurePoint<T>> {
        let mut points = vec![];
        for (contact, &Touching { a, b, .. }) in self.touching.iter().enumerate() {
            let place = |body: usize| group.iter().position(|&j| j == body);
            let Some(x) = place(a) else { continue };
            let y = place(b);
            let (ka, kb) = (&k[x], y.map_or_else(|| self.kinematics(b), |y| k[y]));
            let (sa, sb) = (self.shape(a), self.shape(b));
            for near in manifold(&Pose::of(ka, sa), sa, &Pose::of(&kb, sb), sb).into_iter().flatten() {
                let near = self.grown(near, (a, ka), (b, &kb));
                let point = (near.on_a + near.on_b).scaled(0.5);
                let rate = near.normal.dot(point_velocity(&kb, near.on_b) - point_velocity(ka, near.on_a));
                let sides = [
                    Some(self.pressed(x, a, -near.normal, point - ka.position)),
                    y.map(|y| self.pressed(y, b, near.normal, point - kb.position)),
                ];
                let response = sides.iter().flatten().fold(T::zero(), |sum, s| sum + s.response());
                let bias = curvature(&near, ka, sa, &kb, sb)
                    + rate * (2.0 * STIFFNESS)
                    + near.gap * (STIFFNESS * STIFFNESS);
                if response.value() > 0.0 {
                    points.push(PressurePoint { contact, sides, response, bias, force: T::zero() });
                }
            }
        }
        points
    }

    /// The narrowest gap among kept contacts of the group at these states (m).
    pub(super) fn narrowest(&self, group: &[usize], k: &[Kinematics<T>]) -> f64 {
        let gap = |t: &Touching| {
            let place = |body: usize| group.iter().position(|&j| j == body);
            let ka = k[place(t.a)?].value();
            let kb = place(t.b).map_or_else(|| self.kinematics(t.b).value(), |y| k[y].value());
            Some(facing(&ka, self.shape(t.a), &kb, self.shape(t.b)).0.gap)
        };
        self.touching.iter().filter_map(gap).fold(f64::INFINITY, f64::min)
    }

    fn pressed(&self, at: usize, body: usize, direction: Vec2<T>, arm: Vec2<T>) -> Pressed<T> {
        let mode = self.bodies[body].mode;
        let moves = matches!(mode, Mode::Slide | Mode::Roll);
        let turn = if moves { arm.cross(direction) * self.laws.inverse_inertia[body] } else { T::zero() };
        let rolling = (mode == Mode::Roll).then(|| 1.0 / self.laws.shapes[body].bounding_radius());
        Pressed { at, direction, arm, compliance: self.laws.compliance(body, mode), turn, rolling }
    }
}

/// One point of a kept contact, where a normal force keeps the gap from closing.
struct PressurePoint<T> {
    /// Index among the touching pairs.
    contact: usize,
    sides: [Option<Pressed<T>>; 2],
    /// Opening acceleration per force (1/kg).
    response: T,
    /// Opening acceleration that comes from the velocities, and the correction of the gap (m/s^2).
    bias: T,
    /// N.
    force: T,
}

/// How one body answers a force at a pressure point.
struct Pressed<T> {
    /// Index in the group.
    at: usize,
    /// Where the force pushes it, and from its centre to the point.
    direction: Vec2<T>,
    arm: Vec2<T>,
    /// Acceleration of the centre and of the spin per force.
    compliance: T,
    turn: T,
    /// 1 / radius of a rolling ball.
    rolling: Option<f64>,
}

impl<T: Real> PressurePoint<T> {
    /// One step of projected Gauss-Seidel: the force at which the gap stays closed, never a pull.
    fn press(&mut self, rates: &mut [Rates<T>]) {
        let opening = self.sides.iter().flatten().fold(self.bias, |sum, s| {
            let r = &rates[s.at];
            sum + s.direction.dot(r.velocity + s.arm.perp() * r.spin)
        });
        let total = (self.force - opening / self.response).max(T::zero());
        let more = total - self.force;
        self.force = total;
        for s in self.sides.iter().flatten() {
            let r = &mut rates[s.at];
            let push = s.direction * (s.compliance * more);
            r.velocity += push;
            r.spin += s.turn * more;
            if let Some(inverse_radius) = s.rolling {
                r.roll += push.perp().scaled(inverse_radius);
            }
        }
    }
}

impl<T: Real> Pressed<T> {
    fn response(&self) -> T {
        self.compliance + self.turn * self.arm.cross(self.direction)
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
