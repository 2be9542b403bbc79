//! Where bodies are while a soft contact lasts: the simulation moves them uniformly until one delayed impulse, the spring and
//! damper between them bend their paths from the first touch to the last.

use crate::num::{Real, Vec2};
use crate::world::motion::kinematics::Kinematics;

/// One soft contact of `a` with `b` (or a wall).
#[derive(Debug, Clone, Copy)]
pub(in crate::world) struct Compression<T> {
    pub a: usize,
    pub b: usize,
    /// Instant of the first touch, and from it to the impulse and to the last touch (s).
    pub since: T,
    pub delay: T,
    pub duration: T,
    /// From a to b.
    pub normal: Vec2<T>,
    /// Speed of approach at first touch (m/s), and the share of it at last touch.
    pub approach: T,
    pub restitution: T,
    /// Decay rate of the oscillation (1/s) and square of its angular frequency (1/s^2; negative: overdamped).
    pub decay: T,
    pub square: T,
    /// Share of the compression by which each of the two moves.
    pub shares: [T; 2],
}

impl<T: Real> Compression<T> {
    /// Moves the two from where uniform motion has them at `time` (s) to where the spring and damper have them.
    pub fn apply(&self, time: f64, body: usize, k: &mut Kinematics<T>) {
        let since = -self.since + time;
        if since.value() <= 0.0 || since.value() >= self.duration.value() {
            return;
        }
        let (depth, rate) = self.beyond_uniform(since);
        let share = if body == self.a { self.shares[0] } else { -self.shares[1] };
        k.position += self.normal * (depth * share);
        k.velocity += self.normal * (rate * share);
    }

    /// Compression (m) and its rate (m/s) beyond those of uniform motion, so long after the first touch.
    fn beyond_uniform(&self, since: T) -> (T, T) {
        let (sine, cosine) = oscillation(self.square, since);
        let fades = (-(self.decay * since)).exp() * self.approach;
        let (depth, rate) = (fades * sine, fades * (cosine - self.decay * sine));
        // What other laws take of the rebound is taken up smoothly until the end.
        let end = self.duration;
        let (sine, cosine) = oscillation(self.square, end);
        let fades = (-(self.decay * end)).exp() * self.approach;
        let (depth_at_end, rate_at_end) = (fades * sine, fades * (cosine - self.decay * sine));
        let rebound = self.restitution * self.approach;
        let missing = self.delay * self.approach - rebound * (end - self.delay) - depth_at_end;
        let (slope, u) = (-rebound - rate_at_end, since / end);
        let (u2, u3) = (u * u, u * u * u);
        let smooth = missing * (u2 * 3.0 - u3 * 2.0) + slope * end * (u3 - u2);
        let smooth_rate = missing * (u - u2) * 6.0 / end + slope * (u2 * 3.0 - u * 2.0);
        let (uniform, uniform_rate) = if since.value() < self.delay.value() {
            (self.approach * since, self.approach)
        } else {
            (self.approach * self.delay - rebound * (since - self.delay), -rebound)
        };
        (depth + smooth - uniform, rate + smooth_rate - uniform_rate)
    }
}

/// `sin(w t)/w` and `cos(w t)` for a squared frequency of any sign.
fn oscillation<T: Real>(square: T, t: T) -> (T, T) {
    let phase = square.value() * t.value() * t.value();
    if phase > 1e-6 {
        let w = square.sqrt();
        let (sin, cos) = (w * t).sin_cos();
        (sin / w, cos)
    } else if phase < -1e-6 {
        let w = (-square).sqrt();
        let (up, down) = ((w * t).exp(), (-(w * t)).exp());
        ((up - down) / (w * 2.0), (up + down) * 0.5)
    } else {
        let phase = square * t * t;
        (t - t * phase / 6.0, -(phase * 0.5) + 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::ContactLaw;
    use crate::world::contact::impulse::soft_response;

    /// Against a fine integration of the spring and damper, in a contact that nothing else weakens.
    #[test]
    fn bodies_follow_the_spring_and_damper_while_they_touch() {
        let (mass, k, c, approach) = (0.025f64, 40.0f64, 0.3f64, 0.8f64);
        let mut law = ContactLaw::<f64>::plain();
        (law.softness, law.damping) = (1.0 / k.sqrt(), c);
        let (e, duration) = soft_response(&law, mass);
        let decay = c / (2.0 * mass);
        let contact = Compression {
            a: 0,
            b: 1,
            since: 0.0,
            delay: e * (duration + c / k) / (e + 1.0),
            duration,
            normal: Vec2 { x: 1.0, y: 0.0 },
            approach,
            restitution: e,
            decay,
            square: k / mass - decay * decay,
            shares: [0.5, 0.5],
        };
        let steps = 200_000;
        let dt = duration / f64::from(steps);
        let (mut depth, mut rate) = (0.0, approach);
        for step in 0..steps {
            if step % 20_000 == 10_000 {
                let t = f64::from(step) * dt;
                let uniform = if t < contact.delay {
                    approach * t
                } else {
                    approach * contact.delay - e * approach * (t - contact.delay)
                };
                let found = uniform + contact.beyond_uniform(t).0;
                assert!((found - depth).abs() < 1e-5, "{t}: {found} {depth}");
            }
            rate -= (k * depth + c * rate) / mass * dt;
            depth += rate * dt;
        }
        assert!(contact.beyond_uniform(duration * (1.0 - 1e-9)).0.abs() < 1e-8);
    }
}
