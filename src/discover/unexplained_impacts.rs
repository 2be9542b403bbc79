//! Blows that nothing in sight dealt: where a velocity jumps, and no object near enough takes up the momentum.

use super::smooth_track::{ChangePoint, bends, change_near, positions};
use super::weak_form::WeakFormRegression;
use crate::num::Vec2;
use crate::scene::Scene;
use crate::world::Model;

/// Frames between a jump and the nearness, or the jump, of what may have dealt it.
const BESIDE: usize = 2;
/// Share of the momentum that others must take up, two deviations included, to have dealt the blow: masses are not known well.
const DEALT: f64 = 0.4;

/// All of them, by scene.
pub fn unexplained_impacts(lens: &WeakFormRegression, models: &[Model]) -> Vec<(usize, ChangePoint)> {
    let of = |(index, (scene, model)): (usize, (&Scene, &Model))| {
        impacts_of_scene(lens, index, scene, model)
            .into_iter()
            .map(move |jump| (index, jump))
            .collect::<Vec<_>>()
    };
    lens.scenes.iter().zip(models).enumerate().flat_map(of).collect()
}

fn impacts_of_scene(
    lens: &WeakFormRegression,
    index: usize,
    scene: &Scene,
    model: &Model,
) -> Vec<ChangePoint> {
    let own: Vec<Vec<Option<Vec2>>> = scene.tracks.iter().map(|t| positions(scene, t)).collect();
    let noise = |i: usize| lens.noises[index].of_track(&scene.tracks[i]);
    let mass = |i: usize| model.bodies.get(i).map_or(1.0, |b| b.mass);
    let mut found = vec![];
    for (i, path) in lens.paths[index].iter().enumerate() {
        for jump in bends(scene, &noise(i), &own[i]) {
            let here = |f: usize| f.abs_diff(jump.frame) <= BESIDE;
            let mut others: Vec<usize> = path.near.iter().filter(|n| here(n.0)).map(|n| n.1).collect();
            others.sort_unstable();
            others.dedup();
            // Momentum that an object takes up along the blow, at most.
            let most = |&j: &usize| {
                let (change, sd) = change_near(scene, &noise(j), &own[j], jump.frame, BESIDE)?;
                Some(mass(j) * ((-change.dot(jump.change.unit())).max(0.0) + 2.0 * sd))
            };
            // One whose motion then is not known may have taken all.
            let Some(taken) = others.iter().map(most).sum::<Option<f64>>() else { continue };
            if taken < DEALT * mass(i) * jump.change.norm() {
                found.push(jump);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::tests::{CUBE, DISC, film, models};
    use super::*;

    #[test]
    fn a_blow_that_a_neighbour_did_not_deal_is_told_from_a_collision() {
        // Beside an object that stays where it is, against a wall at x = 1; then two that meet before it.
        let wall =
            [("presence", 1.0), ("offset", -1.0), ("angle", std::f64::consts::PI), ("restitution", 0.8)];
        let beside = vec![(DISC, 0.6, [-0.5, 0.0], [1.2, 0.0]), (CUBE, 2.0, [0.7, 0.5], [0.0, 0.0])];
        let meeting = vec![(DISC, 0.6, [-1.5, 0.0], [1.2, 0.0]), (DISC, 0.6, [-0.5, 0.1], [0.0, 0.0])];
        let scenes = film(&[beside, meeting], Some(("hidden_wall", &wall)));
        let found = unexplained_impacts(&WeakFormRegression::new(&scenes), &models(&scenes));
        let [(0, jump)] = &found[..] else { panic!("{found:?}") };
        assert!((jump.position.x - 0.8).abs() < 0.05 && jump.change.x < -1.0, "{jump:?}");
    }
}
