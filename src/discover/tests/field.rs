//! What people film without saying so: walls around, lenses, magnets, slopes, tables that turn, foam.

use super::super::followed::unfollowed;
use super::super::resample::resampled;
use super::*;

const PUCK: Shape = Shape::Disc { radius: 0.1 };

/// The names of what is found, the verdict, and why.
fn found_in(scenes: &[Scene]) -> Discovery {
    discover(scenes, &models(scenes), &DiscoverOptions::default(), &never).expect("it runs")
}

fn effects(found: &Discovery) -> Vec<&str> {
    found.effects.iter().map(|e| e.effect.as_str()).collect()
}

/// The same on an air table, without friction.
fn on_air(launches: &[Vec<Launch>], law: (&str, &[(&str, f64)])) -> Vec<Scene> {
    let mut scenes = film_under(launches, |model| {
        for p in model.effects.iter_mut().flat_map(|e| &mut e.parameters) {
            if ["sliding", "mu_roll"].contains(&&p.name[..]) {
                p.values.fill(0.0);
            }
        }
        let mut active = ActiveEffect::new(&effect(law.0).expect(law.0).spec, &model.bodies);
        for p in &mut active.parameters {
            if let Some((_, value)) = law.1.iter().find(|v| v.0 == p.name) {
                p.values.fill(*value);
            }
        }
        model.effects.push(active);
    });
    scenes.iter_mut().for_each(|s| s.world = WorldKind::AirTable);
    scenes
}

#[test]
fn walls_around_that_nobody_stated_are_a_rectangle_to_be_stated() {
    let launches = [vec![(PUCK, 0.5, [-0.4, -0.1], [1.6, 0.9])], vec![(PUCK, 0.5, [0.3, 0.2], [-1.4, -1.0])]];
    let sides = [("left", -1.0), ("right", 1.1), ("bottom", -0.7), ("top", 0.6)];
    let values = [&[("presence", 1.0), ("restitution", 0.8)], &sides[..]].concat();
    let scenes = film(&launches, Some(("hidden_walls", &values)));
    let found = found_in(&scenes);
    assert_eq!(effects(&found), ["hidden_walls"], "{}", found.reason);
    assert!(found.reason.contains("# table: "), "{}", found.reason);
    for (name, value) in sides {
        let told = found.effects[0].number(name).expect(name);
        assert!((told - value).abs() < 0.02, "{name} {told}");
    }
}

#[test]
fn a_lens_is_no_pull_to_the_middle() {
    let launches = [
        vec![(PUCK, 0.5, [-2.0, 0.9], [1.3, -0.3]), (PUCK, 0.8, [1.9, -1.2], [-1.2, 0.1])],
        vec![(PUCK, 0.6, [-0.9, -2.0], [0.1, 1.3]), (PUCK, 0.5, [1.2, 1.9], [-0.3, -1.2])],
    ];
    let scenes = film(&launches, Some(("lens_distortion", &[("k", -0.02)])));
    let found = found_in(&scenes);
    assert_eq!(effects(&found), ["lens_distortion"], "{}", found.reason);
    let k = found.effects[0].number("k").expect("it is a number");
    assert!((k + 0.02).abs() < 0.003, "{k}");
}

#[test]
fn a_slope_is_found_where_a_nearly_level_table_was_expected() {
    let launches = [
        vec![(PUCK, 0.5, [-1.5, 0.5], [0.9, 0.1]), (PUCK, 1.2, [1.0, -1.0], [-0.4, 0.5])],
        vec![(PUCK, 0.5, [0.5, 1.5], [-0.5, -0.6]), (PUCK, 1.2, [-1.0, -1.2], [0.3, 0.6])],
    ];
    let found = found_in(&on_air(&launches, ("tilt", &[("a_x", 0.25), ("a_y", -0.1)])));
    assert_eq!(effects(&found), ["tilt"], "{}", found.reason);
    let level = found_in(&on_air(&launches, ("tilt", &[("a_x", 0.006), ("a_y", -0.004)])));
    assert_eq!(level.verdict, Verdict::Adequate, "{}", level.reason);
}

#[test]
fn free_fall_is_a_slope_and_no_wind_as_strong() {
    let throw = |vx: f64, vy: f64| vec![(PUCK, 1.0, [0.0, 0.0], [vx, vy])];
    let mut scenes = on_air(&[throw(1.0, 5.0), throw(-0.6, 4.0)], ("tilt", &[("a_y", -9.81)]));
    for scene in &mut scenes {
        scene.world = WorldKind::Table;
        scene.objects[0].mass = None;
    }
    let found = found_in(&scenes);
    assert_eq!(
        (found.verdict, &effects(&found)[..]),
        (Verdict::EffectFound, &["tilt"][..]),
        "{}",
        found.reason
    );
}

/// At equal masses a sideways force and a table that turns are one, also where the table drives outwards too.
#[test]
fn a_law_that_could_stand_in_for_one_of_two_is_named() {
    let launches = [
        vec![(PUCK, 0.6, [-1.2, 0.1], [1.0, 0.2]), (PUCK, 0.6, [0.8, 0.9], [-0.5, -0.8])],
        vec![(PUCK, 0.6, [-0.2, -1.2], [0.1, 0.9]), (PUCK, 0.6, [1.2, 0.6], [-0.9, 0.3])],
    ];
    let scenes = film_under(&launches, |model| {
        for (name, values) in [("coriolis", [0.3, 0.0, 0.0]), ("centrifugal", [0.15, 0.0, 0.0])] {
            let mut active = ActiveEffect::new(&effect(name).expect(name).spec, &model.bodies);
            active.parameters.iter_mut().zip(values).for_each(|(p, value)| p.values.fill(value));
            model.effects.push(active);
        }
    });
    let found = found_in(&scenes);
    assert_eq!(found.verdict, Verdict::Ambiguous, "{}", found.reason);
    let named = |kind: &str| found.ambiguous.iter().flatten().any(|k| k == kind);
    assert!(named("coriolis") && named("lateral"), "{:?}", found.ambiguous);
    assert!(found.reason.contains("Omega 0.3") || found.reason.contains("Omega 0.29"), "{}", found.reason);
}

/// Slow pucks with weak magnets: what pushes them apart shows only where they meet.
#[test]
fn magnets_that_push_before_they_touch_are_found_where_they_meet() {
    let meeting = |y: f64, speed: f64| {
        vec![(PUCK, 0.5, [-0.7, y], [speed, 0.0]), (PUCK, 0.5, [0.2, 0.0], [-0.1, 0.02])]
    };
    let scenes = on_air(
        &[meeting(-0.02, 0.45), meeting(0.03, 0.5), meeting(0.0, 0.4)],
        ("magnet_repulsion", &[("S", 1.5e-3), ("eps", 0.02)]),
    );
    let found = found_in(&scenes);
    assert!(found.effects.iter().any(|e| e.kind == "pair_repulsion"), "{:?} {}", found.verdict, found.reason);
}

#[test]
fn contacts_that_last_are_named_with_their_duration() {
    let meeting = |y: f64, speed: f64| {
        vec![(PUCK, 0.5, [-0.9, y], [speed, 0.0]), (PUCK, 0.5, [0.2, 0.0], [-0.3, 0.02])]
    };
    // Four frames of 40 ms: half a period of .25 kg.
    let softness = 0.16 / (std::f64::consts::PI * 0.5);
    let scenes = film(
        &[meeting(-0.02, 0.9), meeting(0.03, 0.8), meeting(0.0, 1.0)],
        Some(("soft_contact", &[("softness", softness), ("damping", 0.5)])),
    );
    let found = found_in(&scenes);
    assert_eq!(effects(&found), ["soft_contact"], "{}", found.reason);
    assert!(found.reason.contains("contacts last up to 1"), "{}", found.reason);
}

#[test]
fn contacts_are_blamed_only_where_objects_touch() {
    let alone = || vec![(PUCK, 0.5, [-1.5, 0.2], [0.8, 0.1])];
    let meeting = || vec![(PUCK, 0.5, [-1.5, 0.2], [0.8, 0.1]), (PUCK, 0.5, [-0.9, 0.3], [0.0, 0.0])];
    let why = |launches: [Vec<Launch>; 2]| {
        let mut scenes = film(&launches, None);
        // Frames were dropped twice while their numbers went on.
        for s in scenes.iter_mut().flat_map(|scene| &mut scene.tracks[0].samples) {
            let leaps = [30, 60].iter().filter(|frame| s.frame >= **frame).count();
            s.position += vec2(0.15, 0.02).scaled(leaps as f64);
        }
        let lens = WeakFormRegression::new(&scenes);
        let options = DiscoverOptions::default().fit;
        let last = revise(&lens, &models(&scenes), None, &options, &never).expect("it runs");
        unfollowed(&resampled(&scenes), &last, &options, &never).expect("it runs")
    };
    let (apart, together) = (why([alone(), alone()]), why([meeting(), meeting()]));
    assert!(apart.contains("touches no other object and no wall") && !apart.contains("contact"), "{apart}");
    assert!(together.contains("it is at object"), "{together}");
}
