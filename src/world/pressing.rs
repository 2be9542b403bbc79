//! Contacts that last: bodies that press on each other move together until they part.

use super::geometry::{Feature, Pose, Proximity, manifold};
use super::impact::{Side, facing, point_velocity};
use super::motion::{Kinematics, Mode, Rates};
use super::pressure::{Pressed, PressurePoint, STIFFNESS, balance};
use super::rigid::in_group;
use super::simulate::{Few, Run};
use crate::body::{ContactLaw, Wrench};
use crate::effects::Scalar;
use crate::num::{Real, Vec2};
use crate::scene::Shape;

/// A contact that lasts: bodies `a` and `b` (or wall `b - bodies`) press on each other.
#[derive(Clone, Copy)]
pub(super) struct Touching<T> {
    pub a: usize,
    pub b: usize,
    pub pressing: bool,
    /// Whether it is one of those that hold bodies at rest against what pulls at them.
    pub jams: bool,
    /// Coulomb coefficient between the two.
    pub friction: T,
    /// Share of a ball's rolling that does not rub.
    pub planar: T,
    /// Normal and tangential force at either end (N), as last found: where the next search begins.
    forces: [(f64, f64); 2],
    /// Whether friction was at its bound there.
    slides: [bool; 2],
}

impl<T: Real> Touching<T> {
    pub fn new(a: usize, b: usize, law: &ContactLaw<T>) -> Self {
        let &ContactLaw { friction, ignore_roll: planar, .. } = law;
        let forces = [(0.0, 0.0); 2];
        Touching { a, b, pressing: true, jams: false, friction, planar, forces, slides: [true; 2] }
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
            let (near, rate) = facing(&self.bodies[a].from, self.shape(a), self.kinematics(b), self.shape(b));
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
                    self.touching[c].pressing = self.touching[c].jams
                        || points.iter().any(|p| p.contact == c && p.force.value() > 0.0);
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
    /// one ended.
    pub(super) fn solved(
        &mut self,
        group: &[usize],
        k: &[Kinematics<T>],
        rates: &mut [Rates<T>],
    ) -> Vec<PressurePoint<T>> {
        let mut points = self.pressure_points(group, k);
        balance(&mut points, rates);
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

    /// Bodies at rest that are pressed harder than friction can hold begin to slide, but for those that are `jammed`; whether
    /// any did.
    pub(super) fn wake(
        &mut self,
        group: &[usize],
        jammed: &[usize],
        k: &[Kinematics<T>],
        w: &[Wrench<T>],
    ) -> bool {
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
            if still(self, j) && !jammed.contains(&j) && !self.held(j, group, k, &pressed) {
                for i in self.stuck_to(j) {
                    self.bodies[i].mode = Mode::Slide;
                }
                woken = true;
            }
        }
        woken
    }

    /// The points at which kept contacts of the group press.
    pub(super) fn pressure_points(&self, group: &[usize], k: &[Kinematics<T>]) -> Vec<PressurePoint<T>> {
        let mut points = Vec::with_capacity(2 * self.touching.len());
        let poses: Few<Pose<T>> = group.iter().zip(k).map(|(&j, k)| Pose::of(k, self.shape(j))).collect();
        for (contact, &Touching { a, b, friction, planar, forces, slides, .. }) in
            self.touching.iter().enumerate()
        {
            let place = |body: usize| group.iter().position(|&j| j == body);
            let Some(x) = place(a) else { continue };
            let y = place(b);
            let (ka, kb) = (&k[x], y.map_or_else(|| self.kinematics(b), |y| &k[y]));
            let (sa, sb) = (self.shape(a), self.shape(b));
            let ends = manifold(&poses[x], sa, &y.map_or_else(|| Pose::of(kb, sb), |y| poses[y]), sb);
            for (end, near) in ends.into_iter().enumerate() {
                let Some(near) = near else { continue };
                let near = self.grown(near, (a, ka), (b, kb));
                let point = (near.on_a + near.on_b).scaled(0.5);
                let slip = point_velocity(kb, near.on_b) - point_velocity(ka, near.on_a);
                let n = near.normal;
                let pressed = |at, body, sign| self.pressed((group, k), (at, body), sign, point);
                let sides = [Some(pressed(x, a, -1.0)), y.map(|y| pressed(y, b, 1.0))];
                let response = |d| sides.iter().flatten().fold(T::zero(), |sum, s| sum + s.response(d));
                let (response, tangential_response) = (response(n), response(n.perp()));
                let bias = curvature(&near, ka, sa, kb, sb)
                    + n.dot(slip) * (2.0 * STIFFNESS)
                    + near.gap * (STIFFNESS * STIFFNESS);
                let lift = -(lift_of(ka, sa, n) + lift_of(kb, sb, n)) * (T::constant(1.0) - planar);
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
            let gap = facing(&ka, self.shape(t.a), &kb, self.shape(t.b)).0.gap;
            Some(gap - self.margin(t.a, t.b).value())
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
