//! Angles that differ by whole turns.

/// The angle in -pi..=pi that differs by whole turns.
pub fn wrap_angle(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle - turn * (angle / turn).round()
}
