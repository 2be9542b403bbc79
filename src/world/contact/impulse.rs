//! Impulses of one contact on two bodies, and of a cushion on a ball.
//!
//! Newton's restitution along the unit normal n, Coulomb's friction across it. With the relative velocity `u = v_b - v_a` of the
//! touching points (m/s) and the inverse effective mass `K(p, q)` (1/kg), which is the velocity along p per unit impulse along q:
//!
//! - approach speed `c = -n.u`; the normal impulse `J` (N s) solves `K_nn J - mu s_t K_nt J = (1 + e) c` with restitution e;
//! - friction acts against the slip `s` (unit direction `s_t, s_z`), with `|J_t| <= mu J`, and never reverses more of the slip
//!   than the tangential restitution allows, nor adds energy ([`energy_bound`]).
//!
//! The slip of balls has a vertical component z from their roll. Sources: Stronge, Impact Mechanics (2000), ch. 3; Foerster et
//! al., Physics of Fluids 6 (1994) 1108.

use crate::body::ContactLaw;
use crate::num::{Real, Vec2, elementary};
use crate::world::contact::geometry::Proximity;
use crate::world::motion::kinematics::Kinematics;

/// One side of a contact, with its response to an impulse. A wall has zero mobility.
#[derive(Debug, Clone, Copy)]
pub(in crate::world) struct CollisionBody<T> {
    pub kinematics: Kinematics<T>,
    /// 1/kg.
    pub inverse_mass: T,
    /// 1/(kg m^2).
    pub inverse_inertia: T,
    /// Radius of a ball (m), whose roll the contact can change.
    pub ball: Option<f64>,
}

/// Midpoint between the closest points (m), where the impulse acts.
fn contact_point<T: Real>(near: &Proximity<T>) -> Vec2<T> {
    (near.on_a + near.on_b).scaled(0.5)
}

/// Effective mass of the contact along its normal (kg).
pub(in crate::world) fn effective_mass<T: Real>(
    a: &CollisionBody<T>,
    b: &CollisionBody<T>,
    near: &Proximity<T>,
) -> T {
    let point = contact_point(near);
    let inverse = |s: &CollisionBody<T>| {
        let arm = (point - s.kinematics.position).cross(near.normal);
        s.inverse_mass + arm * arm * s.inverse_inertia
    };
    T::constant(1.0) / (inverse(a) + inverse(b))
}

/// Restitution and duration (s) of a linear spring and damper that moves `mass` (kg) and never pulls. With z the damping ratio
/// and w the angular frequency (rad/s) they are `exp(-2 z f)` and `2 f/w`, `f = acos z / sqrt(1 - z^2)` (Schwager and
/// Poeschel, Granular Matter 9 (2007) 465).
pub(in crate::world) fn soft_response<T: Real>(law: &ContactLaw<T>, mass: T) -> (T, T) {
    let period = mass.sqrt() * law.softness;
    let z = law.damping * law.softness / (mass.sqrt() * 2.0);
    let x = z.value();
    let below = 1.0 - x * x;
    let f = if below > 1e-6 {
        elementary::acos(x) / below.sqrt()
    } else if below < -1e-6 {
        elementary::acosh(x) / (-below).sqrt()
    } else {
        1.0 - (x - 1.0) / 3.0
    };
    let slope = if below.abs() > 1e-6 { (x * f - 1.0) / below } else { -1.0 / 3.0 };
    let f = z.chain(f, slope);
    ((-(z * f * 2.0)).exp(), f * period * 2.0)
}

/// Inverse effective masses of a contact (1/kg) along normal, tangent and vertical.
struct InverseMasses<T> {
    normal: T,
    tangent: T,
    coupling: T,
    vertical: T,
}

/// Normal, tangential and vertical impulse (N s).
type Impulse<T> = (T, T, T);

/// Applies the impulses of one contact to a and b and returns the normal impulse (N s).
pub(in crate::world) fn apply_contact_impulse<T: Real>(
    a: &mut CollisionBody<T>,
    b: &mut CollisionBody<T>,
    near: &Proximity<T>,
    law: &ContactLaw<T>,
) -> T {
    let point = contact_point(near);
    let n = near.normal;
    let t = n.perp();
    let (ra, rb) = (point - a.kinematics.position, point - b.kinematics.position);
    let relative = b.kinematics.velocity_at(point) - a.kinematics.velocity_at(point);
    let approach = -n.dot(relative);
    let response = |p: Vec2<T>, q: Vec2<T>| {
        (a.inverse_mass + b.inverse_mass) * p.dot(q)
            + ra.cross(p) * ra.cross(q) * a.inverse_inertia
            + rb.cross(p) * rb.cross(q) * b.inverse_inertia
    };
    let knn = response(n, n);
    let kick = (law.restitution + 1.0) * approach * law.presence;
    let (mut normal, mut tangential, mut vertical) = (kick / knn, T::zero(), T::zero());
    // At friction zero only its derivative matters.
    if law.friction.value() > 0.0 || T::DIFFERENTIATES {
        let slip_t = t.dot(relative);
        let (slip_z, kzz) = vertical_slip([&*a, &*b], n, law);
        let inverse =
            InverseMasses { normal: knn, tangent: response(t, t), coupling: response(n, t), vertical: kzz };
        if let Some(impulse) = with_friction(law, (approach, kick), (slip_t, slip_z), &inverse) {
            (normal, tangential, vertical) = impulse;
        }
    }
    let impulse = n * normal + t * tangential;
    for (side, r, sign) in [(a, ra, -1.0), (b, rb, 1.0)] {
        let k = &mut side.kinematics;
        k.velocity += impulse * (side.inverse_mass * sign);
        k.spin += r.cross(impulse) * (side.inverse_inertia * sign);
        if let Some(radius) = side.ball {
            // The torque r x J_z of the vertical impulse has the same sign on both sides.
            let radius = (T::constant(1.0) - law.ignore_roll) * radius;
            k.roll += n.perp() * (vertical * side.inverse_inertia * radius);
        }
    }
    normal
}

/// Vertical slip of the surfaces (m/s), from the roll of balls, and the inverse effective mass along it (1/kg). Friction lifts the
/// ball whose surface it pushes up; the table holds the other one.
fn vertical_slip<T: Real>(sides: [&CollisionBody<T>; 2], n: Vec2<T>, law: &ContactLaw<T>) -> (T, T) {
    let (mut slip, mut inverse) = (T::zero(), T::zero());
    let rolling_share = T::constant(1.0) - law.ignore_roll;
    for side in sides {
        if let Some(radius) = side.ball {
            let radius = rolling_share * radius;
            slip -= side.kinematics.roll.cross(n) * radius;
            inverse += side.inverse_inertia * (radius * radius);
        }
    }
    let lifted = if slip.value() > 0.0 { sides[0] } else { sides[1] };
    if lifted.ball.is_some() {
        inverse += rolling_share * lifted.inverse_mass;
    }
    (slip, inverse)
}

/// Impulses with friction; `None` without slip. `kick` is the change of the normal velocity (m/s).
fn with_friction<T: Real>(
    law: &ContactLaw<T>,
    (approach, kick): (T, T),
    (slip_t, slip_z): (T, T),
    k: &InverseMasses<T>,
) -> Option<Impulse<T>> {
    let slip = (slip_t * slip_t + slip_z * slip_z).sqrt_or_zero();
    if slip.value() <= 1e-12 {
        return None;
    }
    let (st, sz) = (slip_t / slip, slip_z / slip);
    let (along, coupling) = (st * st * k.tangent + sz * sz * k.vertical, st * k.coupling);
    // Friction ends where the slip has vanished or is reversed by the tangential restitution.
    let taken = slip * (law.tangential_restitution + 1.0);
    let stick = (taken * k.normal + coupling * kick) / (along * kick + taken * coupling);
    let mu = law.friction.min(stick.max(T::zero()));
    let mu = mu.min(energy_bound((approach, slip, kick), k.normal, coupling, along));
    let normal = kick / (k.normal - mu * st * k.coupling);
    Some((normal, -(mu * normal * st), -(mu * normal * sz)))
}

/// Largest ratio of tangential to normal impulse at which the impulse does no work on the bodies: first positive root of
/// `kick/2 (knn - 2 mu c + mu^2 k) = (approach + mu slip) (knn - mu c)`, c the coupling and k the inverse mass along the slip.
fn energy_bound<T: Real>((approach, slip, kick): (T, T, T), knn: T, coupling: T, along: T) -> T {
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
    // The smallest positive root, in the form without cancellation.
    constant * -2.0 / (linear + discriminant.sqrt())
}

/// Applies the normal impulse that increases the separation speed of two bodies by `by` (m/s).
pub(in crate::world) fn push_apart<T: Real>(
    a: &mut CollisionBody<T>,
    b: &mut CollisionBody<T>,
    near: &Proximity<T>,
    by: T,
) {
    let point = contact_point(near);
    let impulse = near.normal * (by * effective_mass(a, b, near));
    for (side, sign) in [(a, -1.0), (b, 1.0)] {
        let k = &mut side.kinematics;
        k.velocity += impulse * (side.inverse_mass * sign);
        k.spin += (point - k.position).cross(impulse) * (side.inverse_inertia * sign);
    }
}

/// Applies the impulse of a wall's edge to a ball and returns the normal impulse (N s).
///
/// The edge touches the ball [`ContactLaw::contact_height`] radii above its centre. The common normal is inclined by the arc sine of
/// that, and friction acts on the roll about all three axes (Han, 2005). Where friction holds, the rubber reverses a
/// share of the slip (Cross, 2002). The table takes the vertical part.
pub(in crate::world) fn apply_cushion_impulse<T: Real>(
    ball: &mut CollisionBody<T>,
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
    // At least enough to end the approach.
    let kick = ((law.restitution + 1.0) * approach * cosine).max(approach / cosine);
    let normal = kick / ball.inverse_mass;
    // Slip of the touching point along the edge, and along the tangent u = z^ cos - n sin of the inclined plane.
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

#[cfg(test)]
mod tests {
    use crate::num::vec2;
    use crate::scene::Shape;
    use crate::world::tests::{body, model, seconds};
    use crate::world::trace;

    /// A ball rolls into a resting disc. Its surface moves down along the disc, with friction unless contacts ignore the roll.
    #[test]
    fn contact_friction_acts_on_rolling_unless_the_law_ignores_it() {
        let roll_after = |mu: f64, ignore_roll: f64| {
            let mut ball = body(0, Shape::Ball { radius: 0.2 }, vec2(0.0, 0.0), vec2(1.0, 0.0));
            ball.start.rolling = true;
            let disc = body(1, Shape::Disc { radius: 0.2 }, vec2(0.4 + 1e-6, 0.0), vec2(0.0, 0.0));
            let friction: &[f64] = &[mu, 0.0, ignore_roll];
            let m = model(vec![ball, disc], &[("restitution", &[0.8, 1.0]), ("contact_friction", friction)]);
            trace(&m, &seconds(1)).states[1][0].expect("present").roll.norm()
        };
        assert!((roll_after(0.3, 1.0) - 5.0).abs() < 1e-9);
        // Unit masses: mu times the normal impulse of .9, at the radius, on 2/5 m r^2.
        let slips = roll_after(0.3, 0.0);
        assert!((5.0 - slips - 0.3 * 0.9 * 2.5 / 0.2).abs() < 1e-9, "{slips}");
        // Where friction holds, the ball rises as fast as its surface turns down.
        let holds = roll_after(0.5, 0.0);
        assert!((5.0 - holds - 1.0 / 3.5 * 2.5 / 0.2).abs() < 1e-9, "{holds}");
    }

    /// Foerster et al.: where friction holds, the slip after is `-restitution` of that before. Else friction is mu times the
    /// normal impulse.
    #[test]
    fn friction_that_holds_reverses_or_leaves_a_share_of_the_slip() {
        let slip_after = |mu: f64, restitution: f64| {
            let disc = |id, x, vy| body(id, Shape::Disc { radius: 0.2 }, vec2(x, 0.0), vec2(0.0, vy));
            let mut bodies = vec![disc(0, 0.0, 0.0), disc(1, 0.4 + 1e-6, 0.5)];
            bodies[1].start.state.velocity.x = -1.0;
            let m = model(bodies, &[("restitution", &[0.8, 1.0]), ("contact_friction", &[mu, restitution])]);
            let t = trace(&m, &seconds(1));
            let [a, b] = [0, 1].map(|k| t.states[1][k].expect("present"));
            b.velocity.y - a.velocity.y - 0.2 * (a.spin + b.spin)
        };
        for restitution in [-0.6, 0.0, 0.4] {
            let after = slip_after(0.5, restitution);
            assert!((after + 0.5 * restitution).abs() < 1e-3, "{restitution}: {after}");
            // Unit masses: the normal impulse is .9, and a tangential one changes the slip sixfold.
            let after = slip_after(0.02, restitution);
            assert!((after - (0.5 - 6.0 * 0.02 * 0.9)).abs() < 1e-3, "{restitution}: {after}");
        }
    }
}
