//! Exact time of impact between two moving outlines, and the impulses of a contact.

use super::geometry::{Feature, Pose, Proximity, proximity};
use super::motion::Kinematics;
use crate::body::ContactLaw;
use crate::effects::MOST_MARGIN;
use crate::num::{Real, Vec2};
use crate::scene::Shape;

/// Gap that counts as touching (m).
const TOUCH: f64 = 1e-10;
/// Approach speed below which touching bodies do not approach (m/s).
pub(super) const APPROACH: f64 = 1e-9;
/// A gap that Newton's step closes within this time is closed by it (s).
const NEWTON: f64 = 1e-5;
/// Touching bodies that do not approach are looked at again after this time (s).
const GRAZE: f64 = 1e-4;
/// Advances per search before the step has a floor, and the floor as a share of the interval.
const FREE_ADVANCES: usize = 48;
const FLOOR: f64 = 1.0 / 256.0;

/// Motion of one body over a stretch of time: cubic between its ends, real parts only.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path {
    pub start: f64,
    pub end: f64,
    pub shape: Shape,
    from: Kinematics<f64>,
    to: Kinematics<f64>,
    /// Bounds over the stretch: acceleration (m/s^2), turn rate (rad/s), its change (rad/s^2), and the box
    /// it stays in (m).
    acceleration: f64,
    turn_rate: f64,
    turn_acceleration: f64,
    pub low: Vec2,
    pub high: Vec2,
}

impl Path {
    pub fn new(shape: Shape, start: f64, end: f64, from: Kinematics<f64>, to: Kinematics<f64>) -> Self {
        let h = end - start;
        let (mut acceleration, mut turn_rate, mut turn_acceleration) = (0.0, 0.0, 0.0);
        if h > 0.0 {
            let chord = (to.position - from.position).scaled(6.0 / (h * h));
            let a0 = chord - from.velocity.scaled(4.0 / h) - to.velocity.scaled(2.0 / h);
            let a1 = to.velocity.scaled(4.0 / h) + from.velocity.scaled(2.0 / h) - chord;
            acceleration = a0.norm().max(a1.norm());
            let mean = (to.yaw - from.yaw) / h;
            let t0 = 6.0 * mean / h - (4.0 * from.spin + 2.0 * to.spin) / h;
            let t1 = (4.0 * to.spin + 2.0 * from.spin) / h - 6.0 * mean / h;
            turn_acceleration = f64::max(t0.abs(), t1.abs());
            turn_rate = from.spin.abs().max(to.spin.abs()).max((1.5 * mean).abs());
        }
        let bulge = acceleration * h * h / 8.0;
        let reach = shape.bounding_radius() + bulge + 0.5 * MOST_MARGIN + 1e-9;
        let (a, b) = (from.position, to.position);
        let low = Vec2 { x: a.x.min(b.x) - reach, y: a.y.min(b.y) - reach };
        let high = Vec2 { x: a.x.max(b.x) + reach, y: a.y.max(b.y) + reach };
        Path { start, end, shape, from, to, acceleration, turn_rate, turn_acceleration, low, high }
    }

    pub fn at(&self, time: f64) -> Kinematics<f64> {
        let h = self.end - self.start;
        if h <= 0.0 {
            return self.from;
        }
        let s = ((time - self.start) / h).clamp(0.0, 1.0);
        let (s2, s3) = (s * s, s * s * s);
        let (b0, b1, c0, c1) = (1.0 - 3.0 * s2 + 2.0 * s3, 3.0 * s2 - 2.0 * s3, s - 2.0 * s2 + s3, s3 - s2);
        let (d1, e0, e1) = (6.0 * (s - s2) / h, 1.0 - 4.0 * s + 3.0 * s2, 3.0 * s2 - 2.0 * s);
        let (p, q) = (&self.from, &self.to);
        let value = |x0: f64, v0: f64, x1: f64, v1: f64| b0 * x0 + b1 * x1 + h * (c0 * v0 + c1 * v1);
        let slope = |x0: f64, v0: f64, x1: f64, v1: f64| d1 * (x1 - x0) + e0 * v0 + e1 * v1;
        let vector = |f: &dyn Fn(f64, f64, f64, f64) -> f64| Vec2 {
            x: f(p.position.x, p.velocity.x, q.position.x, q.velocity.x),
            y: f(p.position.y, p.velocity.y, q.position.y, q.velocity.y),
        };
        Kinematics {
            position: vector(&value),
            velocity: vector(&slope),
            yaw: value(p.yaw, p.spin, q.yaw, q.spin),
            spin: slope(p.yaw, p.spin, q.yaw, q.spin),
            roll: p.roll,
        }
    }

    pub fn overlaps(&self, o: &Path) -> bool {
        self.low.x <= o.high.x && o.low.x <= self.high.x && self.low.y <= o.high.y && o.low.y <= self.high.y
    }
}

/// How two bodies face each other, with the rate at which the gap opens (m/s).
pub(super) fn facing<T: Real>(
    a: &Kinematics<T>,
    sa: &Shape,
    b: &Kinematics<T>,
    sb: &Shape,
) -> (Proximity<T>, T) {
    let near = proximity(&Pose::new(a.position, a.yaw, sa), sa, &Pose::new(b.position, b.yaw, sb), sb);
    let rate = near.normal.dot(point_velocity(b, near.on_b) - point_velocity(a, near.on_a));
    (near, rate)
}

/// Velocity in the plane of the body's point that is at `point` (m/s).
pub(super) fn point_velocity<T: Real>(k: &Kinematics<T>, point: Vec2<T>) -> Vec2<T> {
    k.velocity + (point - k.position).perp() * k.spin
}

/// First time in `from..to` at which the two touch, `margin` (m) apart, and approach, by conservative advancement: from a gap
/// g that opens at rate r and whose second derivative is at least -B, none can happen before
/// `g + r s - B s^2 / 2` vanishes. The distance of convex outlines is convex in translation, so B is the
/// relative acceleration, seen in the turning frame of the box that carries the face.
pub(super) fn time_of_impact(a: &Path, b: &Path, margin: f64, from: f64, to: f64) -> Option<f64> {
    let radii = a.shape.bounding_radius() + b.shape.bounding_radius() + margin;
    let bound = a.acceleration + b.acceleration;
    let mut time = from;
    for advance in 0.. {
        let (ka, kb) = (a.at(time), b.at(time));
        let delta = kb.position - ka.position;
        let distance = delta.norm();
        let opening = if distance > 0.0 { delta.dot(kb.velocity - ka.velocity) / distance } else { 0.0 };
        let mut step = safe_step(distance - radii, opening, bound);
        if distance - radii <= TOUCH {
            let (mut near, rate) = facing(&ka, &a.shape, &kb, &b.shape);
            near.gap -= margin;
            if near.gap <= TOUCH && rate < -APPROACH {
                return Some(time);
            }
            let speed = (kb.velocity - ka.velocity).norm() + bound * (to - time);
            step = match near.feature {
                Feature::FaceOfB => face_step(b, &kb, a, &ka, -near.normal, margin, speed),
                Feature::FaceOfA => face_step(a, &ka, b, &kb, near.normal, margin, speed),
                Feature::Points if a.shape.is_round() => {
                    safe_step(near.gap, rate, turning_bound(b, a, distance, speed))
                }
                Feature::Points => safe_step(near.gap, rate, turning_bound(a, b, distance, speed)),
            };
            let newton = -near.gap / rate;
            if near.gap > TOUCH && rate < 0.0 && newton < NEWTON && time + newton < to {
                step = step.max(newton);
            } else if near.gap <= TOUCH {
                step = step.max(GRAZE);
            }
        }
        let floor = if advance < FREE_ADVANCES { 1e-12 } else { (to - from) * FLOOR };
        time += step.max(floor);
        if time >= to {
            return None;
        }
    }
    None
}

/// Bound on the second derivative of a guest point's height over a face of `host` (m/s^2).
fn turning_bound(host: &Path, guest: &Path, distance: f64, speed: f64) -> f64 {
    let of = |p: &Path| if p.shape.is_round() { (0.0, 0.0) } else { (p.turn_rate, p.turn_acceleration) };
    let ((wh, ah), (wg, ag)) = (of(host), of(guest));
    let reach = guest.shape.bounding_radius();
    host.acceleration
        + guest.acceleration
        + (wg * wg + ag) * reach
        + 2.0 * wh * (speed + wg * reach)
        + (wh * wh + ah) * (distance + reach)
}

/// Time in which no point of `guest` can reach the face of `host` with this outward normal (s).
fn face_step(
    host: &Path,
    kh: &Kinematics<f64>,
    guest: &Path,
    kg: &Kinematics<f64>,
    normal: Vec2,
    margin: f64,
    speed: f64,
) -> f64 {
    let delta = kg.position - kh.position;
    let bound = turning_bound(host, guest, delta.norm(), speed);
    let turn = Vec2::from_angle(kh.yaw);
    let half = match host.shape.half_extents() {
        Some([x, y]) => {
            if normal.dot(turn).abs() > 0.5 {
                x
            } else {
                y
            }
        }
        None => 0.0,
    };
    let step = |arm: Vec2, radius: f64| {
        let d = delta + arm;
        let velocity = kg.velocity + arm.perp().scaled(kg.spin) - kh.velocity;
        safe_step(
            normal.dot(d) - half - radius - margin,
            normal.dot(velocity) + kh.spin * normal.perp().dot(d),
            bound,
        )
    };
    match guest.shape.half_extents() {
        None => step(Vec2::zero(), guest.shape.bounding_radius()),
        Some([x, y]) => {
            let turn = Vec2::from_angle(kg.yaw);
            let corners = [(x, y), (-x, y), (-x, -y), (x, -y)];
            corners.iter().map(|&(x, y)| step(Vec2 { x, y }.rotated(turn), 0.0)).fold(f64::INFINITY, f64::min)
        }
    }
}

/// Time in which a gap cannot close (s), infinite if it never does.
fn safe_step(gap: f64, rate: f64, bound: f64) -> f64 {
    if gap <= 0.0 && rate <= 0.0 {
        return 0.0;
    }
    if bound <= 0.0 {
        return if rate < 0.0 { -gap / rate } else { f64::INFINITY };
    }
    let root = (rate * rate + 2.0 * bound * gap.max(0.0)).sqrt();
    if rate < 0.0 { 2.0 * gap / (root - rate) } else { (rate + root) / bound }
}

/// One side of a contact: how it answers an impulse. A wall has zero mobility.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side<T> {
    pub kinematics: Kinematics<T>,
    pub inverse_mass: T,
    pub inverse_inertia: T,
    /// Radius of a ball, whose horizontal spin the contact can change.
    pub ball: Option<f64>,
}

/// Mass that a blow along the normal moves (kg).
pub(super) fn effective_mass<T: Real>(a: &Side<T>, b: &Side<T>, near: &Proximity<T>) -> T {
    let point = (near.on_a + near.on_b).scaled(0.5);
    let inverse = |s: &Side<T>| {
        let arm = (point - s.kinematics.position).cross(near.normal);
        s.inverse_mass + arm * arm * s.inverse_inertia
    };
    T::constant(1.0) / (inverse(a) + inverse(b))
}

impl<T: Real> ContactLaw<T> {
    /// Restitution and duration (s) of a spring and damper that moves `mass` (kg) and never pulls: with z the ratio of
    /// the damping to the critical one and w the angular frequency, exp(-2 z f) and 2 f/w, f = acos z / sqrt(1 - z^2).
    pub(super) fn spring(&self, mass: T) -> (T, T) {
        let period = mass.sqrt() * self.softness;
        let z = self.damping * self.softness / (mass.sqrt() * 2.0);
        let x = z.value();
        let below = 1.0 - x * x;
        let f = if below > 1e-6 {
            x.acos() / below.sqrt()
        } else if below < -1e-6 {
            x.acosh() / (-below).sqrt()
        } else {
            1.0 - (x - 1.0) / 3.0
        };
        let slope = if below.abs() > 1e-6 { (x * f - 1.0) / below } else { -1.0 / 3.0 };
        let f = z.chain(f, slope);
        ((-(z * f * 2.0)).exp(), f * period * 2.0)
    }
}

/// Impulses of one contact on a and b, and the normal impulse (N s).
///
/// Newton's restitution along the normal; a tangential impulse against the slip of the touching points, of at
/// most `friction` times the normal one and never more than turns the slip into `-shear` of it (Stronge, Impact Mechanics,
/// ch. 3; Foerster et al., Phys. Fluids 6 (1994) 1108).
/// The slip of balls has a vertical part, which turns them and lifts the one that it pushes up, off a table that holds the other;
/// of it, contacts of the plane know nothing.
pub(super) fn resolve<T: Real>(
    a: &mut Side<T>,
    b: &mut Side<T>,
    near: &Proximity<T>,
    law: &ContactLaw<T>,
) -> T {
    let point = (near.on_a + near.on_b).scaled(0.5);
    let n = near.normal;
    let t = n.perp();
    let (ra, rb) = (point - a.kinematics.position, point - b.kinematics.position);
    let relative = point_velocity(&b.kinematics, point) - point_velocity(&a.kinematics, point);
    let approach = -n.dot(relative);
    let response = |p: Vec2<T>, q: Vec2<T>| {
        (a.inverse_mass + b.inverse_mass) * p.dot(q)
            + ra.cross(p) * ra.cross(q) * a.inverse_inertia
            + rb.cross(p) * rb.cross(q) * b.inverse_inertia
    };
    let knn = response(n, n);
    let kick = (law.restitution + 1.0) * approach * law.presence;
    let mut normal = kick / knn;
    let mut tangential = T::zero();
    let mut vertical = T::zero();
    // At friction zero only its derivative matters.
    if law.friction.value() > 0.0 || T::DIFFERENTIATES {
        let slip_t = t.dot(relative);
        let (mut slip_z, mut kzz) = (T::zero(), T::zero());
        let rubs = T::constant(1.0) - law.ignore_roll;
        for side in [&*a, &*b] {
            if let Some(radius) = side.ball {
                let radius = rubs * radius;
                slip_z -= side.kinematics.roll.cross(n) * radius;
                kzz += side.inverse_inertia * (radius * radius);
            }
        }
        // Friction pushes a up where b's surface rises past it.
        let lifted = if slip_z.value() > 0.0 { &*a } else { &*b };
        if lifted.ball.is_some() {
            kzz += rubs * lifted.inverse_mass;
        }
        let (ktt, knt) = (response(t, t), response(n, t));
        let slip = (slip_t * slip_t + slip_z * slip_z).sqrt_or_zero();
        if slip.value() > 1e-12 {
            let (st, sz) = (slip_t / slip, slip_z / slip);
            let (along, coupling) = (st * st * ktt + sz * sz * kzz, st * knt);
            // Friction ends where the slip does, or what shear gives back, and never so large that the contact would add energy.
            let taken = slip * (law.tangential_restitution + 1.0);
            let stick = (taken * knn + coupling * kick) / (along * kick + taken * coupling);
            let mu = law.friction.min(stick.max(T::zero()));
            let mu = mu.min(passive(approach, slip, kick, knn, coupling, along));
            normal = kick / (knn - mu * st * knt);
            tangential = -(mu * normal * st);
            vertical = -(mu * normal * sz);
        }
    }
    let impulse = n * normal + t * tangential;
    for (side, r, sign) in [(a, ra, -1.0), (b, rb, 1.0)] {
        let k = &mut side.kinematics;
        k.velocity += impulse * (side.inverse_mass * sign);
        k.spin += r.cross(impulse) * (side.inverse_inertia * sign);
        if let Some(radius) = side.ball {
            // Torque r x J z^ of the vertical impulse: both sides turn the same way.
            let radius = (T::constant(1.0) - law.ignore_roll) * radius;
            k.roll += n.perp() * (vertical * side.inverse_inertia * radius);
        }
    }
    normal
}

/// The normal impulse by which two bodies part faster (m/s) than they do.
pub(super) fn push_apart<T: Real>(a: &mut Side<T>, b: &mut Side<T>, near: &Proximity<T>, by: T) {
    let point = (near.on_a + near.on_b).scaled(0.5);
    let impulse = near.normal * (by * effective_mass(a, b, near));
    for (side, sign) in [(a, -1.0), (b, 1.0)] {
        let k = &mut side.kinematics;
        k.velocity += impulse * (side.inverse_mass * sign);
        k.spin += (point - k.position).cross(impulse) * (side.inverse_inertia * sign);
    }
}

/// A ball against the edge of a wall, and the normal impulse (N s).
///
/// The edge touches the ball `law.contact_height` radii above its centre, so the common normal leans by the arc sine of that and
/// friction turns the ball about all three axes (Han, 2005). The edge's rubber shears: where friction holds the touching
/// point, the slip comes back reversed, `law.tangential_restitution` of it (Cross, 2002). The ground takes the vertical part.
pub(super) fn against_edge<T: Real>(
    ball: &mut Side<T>,
    radius: f64,
    near: &Proximity<T>,
    law: &ContactLaw<T>,
) -> T {
    let n = near.normal;
    let t = n.perp();
    let sine = law.contact_height;
    let cosine = (-(sine * sine) + 1.0).sqrt();
    let k = &mut ball.kinematics;
    let approach = n.dot(k.velocity);
    // Never so little that the ball still approaches.
    let kick = ((law.restitution + 1.0) * approach * cosine).max(approach / cosine);
    let normal = kick / ball.inverse_mass;
    // Slip of the ball's point along the edge, and up the tangent u = z^ cos - n sin of the leaning plane.
    let slip_t = t.dot(k.velocity) + (cosine * k.spin - sine * n.dot(k.roll)) * radius;
    let slip_u = -(sine * approach) - t.dot(k.roll) * radius;
    let slip = (slip_t * slip_t + slip_u * slip_u).sqrt_or_zero();
    let (mut along_t, mut along_u) = (T::zero(), T::zero());
    let arm = ball.inverse_inertia * radius;
    if slip.value() > 1e-12 {
        let held = slip * (law.tangential_restitution + 1.0) / (ball.inverse_mass + arm * radius);
        let share = (law.friction * normal).min(held) / slip;
        (along_t, along_u) = (-(slip_t * share), -(slip_u * share));
    }
    k.velocity += (t * along_t - n * (normal * cosine + along_u * sine)) * ball.inverse_mass;
    k.spin += along_t * cosine * arm;
    k.roll -= (n * (along_t * sine) + t * along_u) * arm;
    normal
}

/// Largest ratio of tangential to normal impulse at which the impulse does no work on the bodies:
/// first positive root of `kick/2 (knn - 2 mu c + mu^2 k) = (approach + mu slip) (knn - mu c)`.
fn passive<T: Real>(approach: T, slip: T, kick: T, knn: T, coupling: T, along: T) -> T {
    let square = kick * along * 0.5 + slip * coupling;
    let linear = approach * coupling - kick * coupling - slip * knn;
    let constant = kick * knn * 0.5 - approach * knn;
    let discriminant = linear * linear - square * constant * 4.0;
    if constant.value() >= 0.0 {
        return if linear.value() >= 0.0 || square.value() <= 0.0 { T::zero() } else { -(linear / square) };
    }
    if discriminant.value() <= 0.0 || (square.value() <= 0.0 && linear.value() <= 0.0) {
        return T::constant(f64::INFINITY);
    }
    // The root next to zero on the positive side, in the form that does not cancel.
    constant * -2.0 / (linear + discriminant.sqrt())
}

#[cfg(test)]
mod tests {
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::trace;

    /// A ball that rolls into a resting disc: its surface moves down along the disc, and rubs, where contacts are not of the
    /// plane.
    #[test]
    fn rolling_rubs_but_in_contacts_of_the_plane() {
        let roll_after = |mu: f64, planar: f64| {
            let mut ball = body(0, Shape::Ball { radius: 0.2 }, vec2(0.0, 0.0), vec2(1.0, 0.0));
            ball.start.rolling = true;
            let disc = body(1, Shape::Disc { radius: 0.2 }, vec2(0.4 + 1e-6, 0.0), vec2(0.0, 0.0));
            let friction: &[f64] = &[mu, 0.0, planar];
            let m = model(vec![ball, disc], &[("restitution", &[0.8, 1.0]), ("contact_friction", friction)]);
            trace(&m, &seconds(1)).states[1][0].expect("it is there").roll.norm()
        };
        assert!((roll_after(0.3, 1.0) - 5.0).abs() < 1e-9);
        // Unit masses: mu times the normal impulse of .9, at the radius, on 2/5 m r^2.
        let slips = roll_after(0.3, 0.0);
        assert!((5.0 - slips - 0.3 * 0.9 * 2.5 / 0.2).abs() < 1e-9, "{slips}");
        // Where friction holds, the ball rises as fast as its surface turns down.
        let holds = roll_after(0.5, 0.0);
        assert!((5.0 - holds - 1.0 / 3.5 * 2.5 / 0.2).abs() < 1e-9, "{holds}");
    }

    /// Foerster et al.: the slip that is left is `-shear` of that before where friction holds; else friction gives mu times
    /// the normal impulse.
    #[test]
    fn friction_that_holds_gives_back_or_leaves_a_share_of_the_slip() {
        let slip_after = |mu: f64, shear: f64| {
            let disc = |id, x, vy| body(id, Shape::Disc { radius: 0.2 }, vec2(x, 0.0), vec2(0.0, vy));
            let mut bodies = vec![disc(0, 0.0, 0.0), disc(1, 0.4 + 1e-6, 0.5)];
            bodies[1].start.state.velocity.x = -1.0;
            let m = model(bodies, &[("restitution", &[0.8, 1.0]), ("contact_friction", &[mu, shear])]);
            let t = trace(&m, &seconds(1));
            let [a, b] = [0, 1].map(|k| t.states[1][k].expect("it is there"));
            b.velocity.y - a.velocity.y - 0.2 * (a.spin + b.spin)
        };
        for shear in [-0.6, 0.0, 0.4] {
            let after = slip_after(0.5, shear);
            assert!((after + 0.5 * shear).abs() < 1e-3, "{shear}: {after}");
            // Unit masses: the normal impulse is .9, and a tangential one changes the slip sixfold.
            let after = slip_after(0.02, shear);
            assert!((after - (0.5 - 6.0 * 0.02 * 0.9)).abs() < 1e-3, "{shear}: {after}");
        }
    }
}
